//! The parts of every page: head, style, sections, figures, tables. Pages are single files that load nothing.

use super::number::typeset;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// A whole page. `title` is also its first heading, `lead` the sentence below it.
pub fn page(title: &str, lead: &str, body: &Markup) -> String {
    let body = html! {
        a.skip href="#content" { "Skip to the content" }
        header { h1 { (title) } p.lead { (typeset(lead)) } }
        main id="content" { (body) }
        (footer())
    };
    document(title, include_str!("page.css"), &body)
}

pub(super) fn document(title: &str, style: &str, body: &Markup) -> String {
    let document = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                // Without this, browsers ask the server for an icon.
                link rel="icon" href="data:,";
                style { (PreEscaped(style)) }
            }
            body { (body) }
        }
    };
    document.into_string()
}

pub(super) fn footer() -> Markup {
    html! { footer { "Written by sprung " (env!("CARGO_PKG_VERSION")) ". This page is one file and loads nothing." } }
}

/// A section that links can point to.
pub fn section(id: &str, heading: &str, body: &Markup) -> Markup {
    html! { section id=(id) { h2 { (heading) } (body) } }
}

/// A picture, given as an SVG element, with its caption.
pub fn figure(svg: String, caption: &Markup) -> Markup {
    html! { figure { (PreEscaped(svg)) figcaption { (caption) } } }
}

/// Pictures side by side where the page is wide enough.
pub fn figures(all: impl IntoIterator<Item = Markup>) -> Markup {
    let mut all = all.into_iter().peekable();
    html! { @if all.peek().is_some() { div.figures { @for one in all { (one) } } } }
}

/// A formula in Unicode; an underscore makes what follows, up to the end of the word, a subscript.
pub fn formula(text: &str) -> Markup {
    let mut pieces = text.split('_');
    let first = pieces.next().unwrap_or_default();
    let lowered = pieces.map(|piece| piece.split_at(piece.find(|c: char| !c.is_alphanumeric()).unwrap_or(piece.len())));
    html! { (first) @for (low, rest) in lowered { sub { (low) } (rest) } }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// Text that needs no heading.
    Text,
    /// Text that has its heading beside it where the table becomes a list.
    Named,
    /// Numbers, which have so too.
    Number,
}

#[derive(Debug)]
pub enum Row {
    Cells(Vec<Markup>),
    Failed(Vec<Markup>),
    /// A heading over the rows that follow.
    Heading(String),
}

/// A table with its headings, in which an underscore makes a subscript; `name` says what it holds.
pub fn table(name: &str, class: &str, columns: &[(&str, Column)], rows: impl IntoIterator<Item = Row>) -> Markup {
    let number = |kind: Column| (kind == Column::Number).then_some("number");
    let cells = |cells: Vec<Markup>| {
        html! {
            @for (&(title, kind), cell) in columns.iter().zip(cells) {
                td class=[number(kind)] data-of=[(kind != Column::Text).then(|| title.replace('_', ""))] { (cell) }
            }
        }
    };
    let table = html! {
        table class=(class) {
            thead { tr { @for &(title, kind) in columns { th.number[kind == Column::Number] scope="col" { (formula(title)) } } } }
            tbody {
                @for row in rows {
                    @match row {
                        Row::Cells(row) => tr { (cells(row)) },
                        Row::Failed(row) => tr.failed-row { (cells(row)) },
                        Row::Heading(text) => tr.why { td colspan=(columns.len()) { (typeset(&text)) } },
                    }
                }
            }
        }
    };
    scrolling(name, &table)
}

/// A table that scrolls sideways where the page is too narrow for it; `name` says what it holds.
pub fn scrolling(name: &str, table: &Markup) -> Markup {
    html! { div.scroll role="region" aria-label=(name) tabindex="0" { (table) } }
}

/// Something long, folded away behind a line that says what it is. Printing shows it.
pub fn folded(summary: &str, body: &Markup) -> Markup {
    html! { details.values { summary { (summary) } (body) } }
}
