//! What stands above the axes of every picture: its title, and what it says, in a sentence.

use super::canvas::{self, Align, Drawn, LINE, Sheet, WIDTH};
use super::{number, palette};
use maud::{Markup, html};

/// A title and a conclusion, in lines.
pub(super) struct Heading {
    title: Vec<String>,
    conclusion: Vec<String>,
}

impl Heading {
    /// Breaks both to the width of a picture. An empty conclusion takes no line.
    pub fn new(title: &str, conclusion: &str) -> Self {
        let lines = |text: &str| if text.is_empty() { Vec::new() } else { canvas::wrap(text, WIDTH - 32) };
        let set = |text: &str| lines(&number::typeset(text));
        Self { title: set(title), conclusion: set(conclusion) }
    }

    /// How far down it reaches, in pixels.
    pub fn height(&self) -> i32 {
        14 + LINE * (self.title.len() + self.conclusion.len()) as i32
    }

    /// The same for pictures that are written and not drawn.
    pub fn markup(&self) -> Markup {
        let lines =
            self.title.iter().map(|line| (line, Some("bold"))).chain(self.conclusion.iter().map(|line| (line, None)));
        html! {
            @for (row, (line, weight)) in lines.enumerate() {
                text x="16" y=(10 + LINE * row as i32 + 26) font-weight=[weight] { (line) }
            }
        }
    }

    /// Draws it at the top of a sheet.
    pub fn draw(&self, sheet: &Sheet<'_>) -> Drawn {
        let mut rows = (0..).map(|i| 10 + LINE / 2 + LINE * i);
        for (line, row) in self.title.iter().zip(&mut rows) {
            sheet.heading(line, (16, row))?;
        }
        for (line, row) in self.conclusion.iter().zip(rows) {
            sheet.text(line, (16, row), Align::Left, palette::INK)?;
        }
        Ok(())
    }
}
