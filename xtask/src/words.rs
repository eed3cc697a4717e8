//! Names and sentences of the source in the terms of the field.

use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Files and folders of modules that were renamed to a term of the field.
const FILES: &str = "
    along answered aside asked astray believed bend cast doubts driven eight exactness floppiness held
    in_a_row kept lanes leaps ledger left_out merit nearby outlook parting pieces quad rails ran room
    ruler sameness settled shares shown sixes slip softening strayed taken thinning told
";

/// Types that were renamed to a term of the field.
const TYPES: &str = "
    Account Adaptivity Asked Assurance Astray Audience Believed Carried CarriedErrors Cast Contest
    Course Driven Glance Held InARow Kept Lane Lanes Lbl Ledger Margins Meter Moment MovesBy OfMotion
    Onlooker Outlook Pace Parting Peers Price Quad Question Rails Ran Reach Refusal Ruler Share Shares
    Shown Softening Strayed Taken Thinning Tried Turning Way Went Why Widely
";

/// The largest part of documentation paragraphs that may begin with a question word.
const LARGEST_PART: f64 = 0.05;

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// The source files of the crate, by their paths within `src`.
fn sources() -> Vec<(PathBuf, String)> {
    let folder = crate::root().unwrap().join("src");
    let mut files = Vec::new();
    collect(&folder, &mut files);
    files.sort();
    let read = |file: PathBuf| (file.strip_prefix(&folder).unwrap().to_owned(), fs::read_to_string(&file).unwrap());
    files.into_iter().map(read).collect()
}

/// The number of documentation paragraphs of a file, and the lines of those that begin with a question word. Items of lists, rows of tables,
/// headings and code are not paragraphs.
fn paragraphs(code: &str) -> (usize, Vec<usize>) {
    let question = Regex::new(r"^(What|How|Whether|Of)\b").unwrap();
    let (mut count, mut found) = (0, Vec::new());
    let (mut is_code, mut is_continued) = (false, false);
    for (number, line) in code.lines().enumerate() {
        let line = line.trim_start();
        let Some(text) = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")).map(str::trim) else {
            (is_code, is_continued) = (false, false);
            continue;
        };
        is_code ^= text.starts_with("```");
        let is_text = !is_code && text.chars().next().is_some_and(|first| !"`|#-".contains(first));
        if is_text && !is_continued {
            count += 1;
        }
        // A question word with a capital begins a sentence, within a paragraph too.
        if is_text && question.is_match(text) {
            found.push(number + 1);
        }
        is_continued = is_text;
    }
    (count, found)
}

/// A summary is a noun phrase or a verb, not a question.
#[test]
fn documentation_begins_with_nouns_and_verbs() {
    let (mut all, mut places) = (0, Vec::new());
    for (file, code) in sources() {
        let (count, found) = paragraphs(&code);
        all += count;
        places.extend(found.iter().map(|line| format!("{}:{line}", file.display())));
    }
    let part = places.len() as f64 / all as f64;
    assert!(
        part < LARGEST_PART,
        "{} of {all} documentation paragraphs begin with What, How, Whether or Of ({:.1} %):\n{}",
        places.len(),
        100.0 * part,
        places.join("\n")
    );
}

/// A renamed file or type does not come back under its old name.
#[test]
fn files_and_types_have_the_names_of_the_field() {
    let [files, types] = [FILES, TYPES].map(|words| words.split_whitespace().collect::<BTreeSet<&str>>());
    let definition = Regex::new(r"(?m)^\s*(?:pub(?:\([^)]*\))? )?(?:struct|enum|trait|type|union) (\w+)").unwrap();
    let mut found = BTreeSet::new();
    for (file, code) in sources() {
        for part in file.with_extension("").iter().filter_map(|part| part.to_str()) {
            if files.contains(part) {
                found.insert(format!("{}: {part}", file.display()));
            }
        }
        for defined in definition.captures_iter(&code) {
            if types.contains(&defined[1]) {
                found.insert(format!("{}: {}", file.display(), &defined[1]));
            }
        }
    }
    let list: Vec<String> = found.into_iter().collect();
    assert!(list.is_empty(), "{} private names:\n{}", list.len(), list.join("\n"));
}

#[test]
fn paragraphs_are_counted_without_lists_and_code() {
    let code = "//! How it works.\n//! It works.\n//!\n//! Of two.\n\n/// A force\n/// What it is.\n/// ```\n/// How\n\
                /// ```\n/// - What\nfn f() {}\n";
    assert_eq!(paragraphs(code), (3, vec![1, 4, 7]));
}

/// Numbers that stand in two pages for different things.
const COINCIDENCES: [&str; 3] = ["1.45 times", "15 %", "64 times"];

/// Numbers with a unit and at least two digits, in the prose of a page: what may have been measured.
fn measured(page: &str) -> BTreeSet<String> {
    let code = Regex::new(r"(?s)```.*?```|`[^`]*`").unwrap();
    let number =
        Regex::new(r"(?:^|[^\w.])(\d[\d.]*\d)[  ](%|times|ns|µs|ms|s|seconds|minutes|hours|kB|MB|GB|MiB|GiB)(?:\W|$)");
    let page = code.replace_all(page, "");
    let prose = page.lines().filter(|line| !line.trim_start().starts_with('|'));
    let number = number.unwrap();
    prose
        .flat_map(|line| {
            number.captures_iter(line).map(|found| format!("{} {}", &found[1], &found[2])).collect::<Vec<_>>()
        })
        .filter(|found| found.chars().filter(char::is_ascii_digit).collect::<String>().trim_matches('0').len() >= 2)
        .collect()
}

/// A measured number stands in one page; others link to it. The help of the command is a page too.
#[test]
fn measured_numbers_stand_in_one_page() {
    let root = crate::root().unwrap();
    let mut pages = vec![("--help".to_owned(), String::new())];
    for (_, code) in sources().iter().filter(|(file, _)| file.starts_with("cli")) {
        code.lines()
            .filter_map(|line| line.trim_start().strip_prefix("///"))
            .for_each(|line| pages[0].1 += &(line.to_owned() + "\n"));
    }
    let mut folders = ["docs", "verification"].map(|folder| root.join(folder)).to_vec();
    let mut files = vec![root.join("README.md"), root.join("python/README.md")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => files.push(path),
            }
        }
    }
    // Pages of measurements take in their remarks.
    let is_page =
        |path: &PathBuf| path.extension().is_some_and(|extension| extension == "md") && !path.ends_with("remarks.md");
    for file in files.into_iter().filter(is_page) {
        pages.push((file.strip_prefix(&root).unwrap().display().to_string(), fs::read_to_string(&file).unwrap()));
    }
    let mut places: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for (name, page) in &pages {
        measured(page).into_iter().for_each(|number| places.entry(number).or_default().push(name));
    }
    places.retain(|number, pages| pages.len() > 1 && !COINCIDENCES.contains(&number.as_str()));
    let list: Vec<String> = places.iter().map(|(number, pages)| format!("{number}: {}", pages.join(", "))).collect();
    assert!(list.is_empty(), "{} numbers stand in more than one page:\n{}", list.len(), list.join("\n"));
}

#[test]
fn numbers_with_units_are_measured() {
    let page =
        "It takes 2.5 s, 31 times as long (0.35 MB).\n`12 s` and 0.5 s, 100 %\n| 77 s |\n```\n88 s\n```\nv1.25 s4\n";
    assert_eq!(measured(page).into_iter().collect::<Vec<_>>(), ["0.35 MB", "2.5 s", "31 times"]);
}
