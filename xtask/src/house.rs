//! The modules and what they use, drawn from the code: imports point one way only.
//!
//! The order is that of the table in `src/lib.rs`. A module may use those above it, and those that serve all.

use crate::circles;
use anyhow::{Context, Result, ensure};
use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Modules that serve all others, each using only those before it.
const SERVING: [&str; 6] = ["error", "work", "interrupt", "memory", "parallel", "registers"];

/// Draws the house, and fails where an arrow runs back up.
pub fn draw(root: &Path) -> Result<()> {
    let source = root.join("src");
    let order = order(&fs::read_to_string(source.join("lib.rs"))?)?;
    let mut house = BTreeMap::new();
    for module in &order {
        let mut files = Vec::new();
        if source.join(module).is_dir() {
            circles::collect(&source.join(module), &mut files)?;
        }
        let file = source.join(module).with_extension("rs");
        files.extend(file.exists().then_some(file));
        ensure!(!files.is_empty(), "src/lib.rs lists {module}, which is no module");
        let mut used = BTreeSet::new();
        for file in files {
            used.extend(uses(&fs::read_to_string(&file).with_context(|| file.display().to_string())?)?);
        }
        used.remove(module);
        house.insert(module.clone(), used);
    }
    print!("{}", picture(&order, &house));
    let wrong = back_up(&order, &house);
    ensure!(wrong.is_empty(), "arrows that run back: {}", wrong.join(", "));
    println!("{} modules; every arrow leads up this list: no circle", order.len());
    let sources = ["src", "xtask/src", "python/src", "distributed/src", "benches/peers/src"];
    for source in sources {
        let circles = circles::find(&root.join(source))?;
        let shown: Vec<String> = circles.iter().map(|circle| circle.join(", ")).collect();
        ensure!(shown.is_empty(), "files of {source} that use each other in a circle: {}", shown.join("; "));
    }
    println!("no circle between the files of {}", sources.join(", "));
    Ok(())
}

/// The modules in the order of their use: those that serve, and those of the table.
fn order(library: &str) -> Result<Vec<String>> {
    let row = Regex::new(r"(?m)^//! \| \[`([a-z_]+)`\]")?;
    let listed = row.captures_iter(library).map(|found| found[1].to_owned());
    Ok(SERVING.into_iter().map(str::to_owned).chain(listed).collect())
}

/// The modules that the code of a file uses; documentation and tests may look anywhere.
fn uses(code: &str) -> Result<BTreeSet<String>> {
    let path = Regex::new(r"\bcrate::(?:\{([^}]*)\}|([a-z_]+))")?;
    let code = code.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let code = code.split("#[cfg(all(test, feature = \"scene\"))]\nmod tests {").next().unwrap_or_default();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    let mut used = BTreeSet::new();
    for found in path.captures_iter(&lines) {
        match (found.get(1), found.get(2)) {
            (Some(list), _) => {
                let names = list.as_str().split(',').filter_map(|item| item.trim().split("::").next());
                used.extend(names.map(str::to_owned));
            }
            (_, Some(name)) => _ = used.insert(name.as_str().to_owned()),
            _ => {}
        }
    }
    Ok(used)
}

/// Arrows from a module to one that is not above it.
fn back_up(order: &[String], house: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let place = |name: &String| order.iter().position(|other| other == name);
    let mut wrong = Vec::new();
    for (module, used) in house {
        let below = used.iter().filter(|other| place(other).is_some_and(|at| Some(at) > place(module)));
        wrong.extend(below.map(|other| format!("{module} → {other}")));
    }
    wrong
}

/// A line a module: how many stories it stands on, and what it uses beside what serves all.
fn picture(order: &[String], house: &BTreeMap<String, BTreeSet<String>>) -> String {
    let mut storeys: BTreeMap<&str, usize> = BTreeMap::new();
    let mut text = String::new();
    for module in order {
        let used = house.get(module).into_iter().flatten();
        let known: Vec<&str> = used.map(String::as_str).filter(|name| order.iter().any(|m| m == name)).collect();
        let storey = known.iter().filter_map(|name| storeys.get(name)).max().map_or(0, |below| below + 1);
        storeys.insert(module, storey);
        let shown: Vec<&str> = known.into_iter().filter(|name| !SERVING.contains(name)).collect();
        text += &format!("{storey:2}  {module:<11}{}\n", shown.join(" "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{back_up, draw, order, uses};
    use std::collections::{BTreeMap, BTreeSet};

    #[test]
    fn the_house_has_no_circle() {
        draw(&crate::root().unwrap()).unwrap();
    }

    #[test]
    fn uses_are_those_of_the_code_alone() {
        let code = "//! [`x`](crate::doc)\nuse crate::{force::F, work};\nfn f() { crate::spring::g() }\n\
                    #[cfg(test)]\nmod tests {\n    use crate::scene::S;\n}\n";
        let expected = ["force", "spring", "work"].map(str::to_owned);
        assert_eq!(uses(code).unwrap(), BTreeSet::from(expected));
    }

    #[test]
    fn arrows_down_the_list_are_found() {
        let listed = order("//! | [`a`] | x |\n//! | [`b`] | y |\n").unwrap();
        let uses = |name: &str| BTreeSet::from([name.to_owned()]);
        let house = BTreeMap::from([("a".to_owned(), uses("b")), ("b".to_owned(), uses("error"))]);
        assert_eq!(back_up(&listed, &house), ["a → b"]);
    }
}
