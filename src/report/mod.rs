//! Results as HTML with plots and drawings, as JSON, as JUnit, and as text for the terminal.
//!
//! All output is a function of the data alone, without clock, host or random identifiers: the same results give the same bytes.

mod axis;
mod bound_usage;
mod chart_html;
mod check_html;
mod definiteness_html;
pub mod drawing;
mod formats;
mod html;
pub mod inspection;
pub mod number;
pub mod page;
pub mod plot;
mod sheet;
pub mod spy;
pub mod statics;
pub mod tiles;
pub mod view;

pub use chart_html::chart_html;
pub use definiteness_html::{definiteness_html, definiteness_text};
pub use formats::{failure, json, junit, text};
pub use html::html;

use crate::error::{Error, Result};
use crate::verify::Results;
use std::io::{self, Write};
use std::path::Path;

/// Writes `report.html`, `report.json` and `junit.xml` into a folder, which is created. A file is replaced only by a whole one.
///
/// # Errors
/// [`Error::Io`] with the file or folder that cannot be written.
pub fn write(folder: impl AsRef<Path>, results: &Results) -> Result<()> {
    let folder = folder.as_ref();
    std::fs::create_dir_all(folder).map_err(|source| Error::io(folder, source))?;
    let contents = [("report.html", Ok(html(results))), ("report.json", json(results)), ("junit.xml", junit(results))];
    for (name, content) in contents {
        let path = folder.join(name);
        content.and_then(|content| replace(&path, folder, &content)).map_err(|source| Error::io(&path, source))?;
    }
    Ok(())
}

/// Writes a file under another name first.
fn replace(path: &Path, folder: &Path, content: &str) -> io::Result<()> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // Temporary files are readable by their owner alone; a report is as readable as any other new file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.prefix(".report-").tempfile_in(folder)?;
    file.write_all(content.as_bytes())?;
    file.persist(path).map(drop).map_err(|failed| failed.error)
}
