
/// Is this fault switched on? A switch that is passed for the first time is noted.
#[inline]
pub fn planted(number: usize) -> bool {
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicBool, Ordering};
    static ON: OnceLock<(usize, Option<std::path::PathBuf>)> = OnceLock::new();
    static NOTED: [AtomicBool; COUNT] = [const { AtomicBool::new(false) }; COUNT];
    let (on, file) = ON.get_or_init(|| {
        let on = std::env::var("SWITCH").ok().and_then(|text| text.parse().ok());
        (on.unwrap_or(0), std::env::var_os("REACHED").map(Into::into))
    });
    if let Some(file) = file
        && !NOTED[number].swap(true, Ordering::Relaxed)
        && let Ok(mut file) = std::fs::OpenOptions::new().create(true).append(true).open(file)
    {
        let _ = std::io::Write::write_all(&mut file, format!("{number}\n").as_bytes());
    }
    *on == number
}
