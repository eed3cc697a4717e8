//! Spans of time in words.

use std::time::Duration;

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

/// An estimate: whole seconds, one at least.
pub fn roughly(span: Duration) -> String {
    match span.as_secs() {
        few @ 0..60 => format!("{} s", few.max(1)),
        many => in_words(many as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::{Duration, in_words, roughly};

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
        for (seconds, words) in [(0.2, "1 s"), (9.9, "9 s"), (75.3, "1 min 15 s"), (7523.0, "2 h 5 min")] {
            assert_eq!(roughly(Duration::from_secs_f64(seconds)), words);
        }
    }
}
