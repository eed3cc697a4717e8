//! Spans of time in words.

/// Seconds as people say them: `0.35 s`, `12.4 s`, `1 min 49 s`, `2 h 5 min`.
pub fn in_words(seconds: f64) -> String {
    if seconds < 9.995 {
        return format!("{seconds:.2} s");
    }
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, minutes, 0) => format!("{minutes} min"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, 0, _) => format!("{hours} h"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::in_words;

    #[test]
    fn spans_are_said_as_people_do() {
        let spans = [
            (0.0, "0.00 s"),
            (0.3512, "0.35 s"),
            (9.996, "10.0 s"),
            (59.9, "59.9 s"),
            (59.96, "1 min"),
            (108.6, "1 min 49 s"),
            (3600.0, "1 h"),
            (7523.0, "2 h 5 min"),
        ];
        for (seconds, words) in spans {
            assert_eq!(in_words(seconds), words);
        }
    }
}
