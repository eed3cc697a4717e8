//! All mutants of a file in one source: every function holds its own body and, behind a switch, one for each mutant.
//!
//! A build for each of two thousand mutants would take a night. With a switch one build holds them all, and an environment
//! variable chooses one (R. H. Untch, A. J. Offutt and M. J. Harrold, Mutation analysis using mutant schemata, ISSTA 1993).

use super::listed::{Mutant, Place, Span};
use std::fmt::Write as _;
use std::ops::Range;

/// The environment variable that holds the number of the mutant that is to act; none acts without it.
pub const VARIABLE: &str = "SPRUNG_MUTANT";

/// The environment variable that names a file, which gets the number of every function that is entered.
pub const ENTERED: &str = "SPRUNG_ENTERED";

/// The lints of the copy: a mutant that offends one compiles.
pub const LINTS: &str =
    "[lints.rust]\nwarnings = \"allow\"\narithmetic_overflow = \"allow\"\nunconditional_panic = \"allow\"\n";

/// What the library of the copy is given: the number of the mutant that acts, read once a process, and a type for functions
/// that return `impl Iterator`, whose arms must be of one type. Functions go by the number of their first mutant.
pub const LIBRARY: &str = r#"
#[doc(hidden)]
pub mod mutants {
    use std::io::Write as _;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::OnceLock;
    pub fn active(function: usize) -> u32 {
        static ACTIVE: OnceLock<(u32, Option<String>)> = OnceLock::new();
        let variable = |name| std::env::var(name).ok();
        let (active, entered) = ACTIVE.get_or_init(|| {
            (variable("SPRUNG_MUTANT").and_then(|n| n.parse().ok()).unwrap_or(0), variable("SPRUNG_ENTERED"))
        });
        if let Some(entered) = entered {
            note(function, entered);
        }
        *active
    }
    // Does not allocate: a test counts that.
    #[cold]
    fn note(function: usize, entered: &str) {
        static NOTED: [AtomicBool; 40_000] = [const { AtomicBool::new(false) }; 40_000];
        if !NOTED[function].swap(true, Ordering::Relaxed) {
            let mut line = [0; 24];
            let mut rest = &mut line[..];
            writeln!(rest, "{function}").unwrap();
            let length = 24 - rest.len();
            std::fs::File::options().append(true).open(entered).unwrap().write_all(&line[..length]).unwrap();
        }
    }
    pub enum Arm<'a, I: Iterator> {
        Mutant(Box<dyn Iterator<Item = I::Item> + 'a>),
        Own(I),
    }
    impl<I: Iterator> Iterator for Arm<'_, I> {
        type Item = I::Item;
        fn next(&mut self) -> Option<I::Item> {
            match self {
                Arm::Mutant(mutant) => mutant.next(),
                Arm::Own(own) => own.next(),
            }
        }
    }
}
"#;

/// A source with switches.
pub struct Switched {
    pub source: String,
    pub mutants: Vec<Arm>,
}

/// A mutant in a source with switches: its number, that of its function, whether it replaces all of that, and its lines.
pub struct Arm {
    pub number: usize,
    pub function: usize,
    pub is_whole: bool,
    pub lines: Range<usize>,
}

/// A function and its mutants.
struct Switch<'m> {
    body: Range<usize>,
    /// Whether it returns `impl Trait`.
    is_opaque: bool,
    mutants: Vec<(usize, &'m Mutant)>,
}

/// Puts the mutants, given with their numbers, into a source.
pub fn switched(source: &str, mutants: &[(usize, &Mutant)]) -> Option<Switched> {
    let mut functions: Vec<Switch> = Vec::new();
    for &(number, mutant) in mutants {
        let function = mutant.function.as_ref()?;
        let body = body(source, range(source, function.span)?)?;
        match functions.iter_mut().find(|function| function.body == body) {
            Some(function) => function.mutants.push((number, mutant)),
            None => {
                let is_opaque = function.return_type.starts_with("-> impl ");
                functions.push(Switch { body, is_opaque, mutants: vec![(number, mutant)] });
            }
        }
    }
    functions.sort_by_key(|function| function.body.start);
    // A function within another one is a part of its body.
    let mut outermost: Vec<Switch> = Vec::new();
    for function in functions {
        match outermost.last_mut().filter(|outer| function.body.start < outer.body.end) {
            Some(outer) => outer.mutants.extend(function.mutants),
            None => outermost.push(function),
        }
    }
    let functions = outermost;
    let (mut text, mut arms, mut written) = (String::new(), Vec::new(), 0);
    for Switch { body, is_opaque, mutants } in functions {
        text += source.get(written..body.start)?;
        let (open, own, close) = if is_opaque {
            ("crate::mutants::Arm::Mutant(Box::new(", "crate::mutants::Arm::Own(", ")")
        } else {
            ("", "", "")
        };
        let &(function, _) = mutants.first()?;
        let _ = writeln!(text, "{{ match crate::mutants::active({function}) {{");
        for (number, mutant) in mutants {
            let place = range(source, mutant.span)?;
            let first = text.lines().count() + 1;
            let (before, after) = (source.get(body.start..place.start)?, source.get(place.end..body.end)?);
            let _ = writeln!(text, "{number} => {open}{before} {} {after}{close}{close},", mutant.replacement);
            let is_whole = before.trim() == "{" && after.trim() == "}";
            arms.push(Arm { number, function, is_whole, lines: first..text.lines().count() + 1 });
        }
        let _ = write!(text, "_ => {own}{}{close},\n}} }}", source.get(body.clone())?);
        written = body.end;
    }
    text += source.get(written..)?;
    // Inlined, a function with a hundred bodies would be compiled wherever it is called.
    let text =
        ["#[inline]", "#[inline(always)]"].iter().fold(text, |text, often| text.replace(often, "#[inline(never)]"));
    Some(Switched { source: text, mutants: arms })
}

/// A source with one mutant in place, for those in constants, which no switch can choose while the program runs.
pub fn replaced(source: &str, mutant: &Mutant) -> Option<String> {
    let place = range(source, mutant.span)?;
    Some(format!("{} {} {}", source.get(..place.start)?, mutant.replacement, source.get(place.end..)?))
}

/// The body of a function, braces included: from the first brace that stands in no other bracket, after the comments on the function.
fn body(source: &str, function: Range<usize>) -> Option<Range<usize>> {
    let text = source.get(function.clone())?;
    let is_comment = |line: &&str| line.trim_start().starts_with("//");
    let head: usize = text.split_inclusive('\n').take_while(is_comment).map(str::len).sum();
    let mut depth = 0;
    for (at, character) in text.get(head..)?.char_indices() {
        match character {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            '{' if depth == 0 => return Some(function.start + head + at..function.end),
            _ => {}
        }
    }
    None
}

/// A span as a range of bytes.
fn range(source: &str, span: Span) -> Option<Range<usize>> {
    Some(byte(source, span.start)?..byte(source, span.end)?)
}

fn byte(source: &str, place: Place) -> Option<usize> {
    let before: usize = source.split_inclusive('\n').take(place.line - 1).map(str::len).sum();
    let line = source.get(before..)?;
    line.char_indices().map(|(at, _)| at).chain([line.len()]).nth(place.column - 1).map(|at| before + at)
}
