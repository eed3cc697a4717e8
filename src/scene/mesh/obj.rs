//! Wavefront OBJ: `v`, `f` and `l`; everything else is passed over.

use super::raw::{Fault, Raw};

pub fn read(bytes: &[u8]) -> Result<Raw, Fault> {
    // Comments and names may be in any encoding.
    let text = String::from_utf8_lossy(bytes);
    let mut raw = Raw::new("line", 1);
    let mut corners = Vec::new();
    let mut continued = String::new();
    let mut begun = None;
    for (number, line) in (1u32..).zip(text.lines()) {
        let line = line.split('#').next().unwrap_or_default().trim_end();
        let place = *begun.get_or_insert(number);
        if let Some(part) = line.strip_suffix('\\') {
            continued.push_str(part);
            continued.push(' ');
            continue;
        }
        begun = None;
        if continued.is_empty() {
            add(&mut raw, line, place, &mut corners)?;
        } else {
            continued.push_str(line);
            add(&mut raw, &std::mem::take(&mut continued), place, &mut corners)?;
        }
    }
    if raw.vertices() == 0 {
        return Err(Fault("is no mesh: neither OBJ (no line begins with v), PLY, STL, VTK nor Gmsh MSH".into()));
    }
    Ok(raw)
}

fn add(raw: &mut Raw, line: &str, place: u32, corners: &mut Vec<u32>) -> Result<(), Fault> {
    let fault = |message: String| Fault(format!("line {place}: {message}: {:?}", line.trim()));
    let mut words = line.split_whitespace();
    match words.next() {
        Some("v") => {
            let mut x = [0.0; 3];
            for x in &mut x {
                let word = words.next().ok_or_else(|| fault("a vertex has three coordinates".into()))?;
                *x = word.parse().map_err(|_| fault(format!("{word:?} is no number")))?;
            }
            raw.add_vertex(x);
        }
        Some(kind @ ("f" | "l")) => {
            corners.clear();
            for word in words {
                corners.push(vertex(word, raw.vertices()).map_err(fault)?);
            }
            if kind == "f" { raw.add_face(corners, place) } else { raw.add_line(corners, place) }
        }
        _ => {}
    }
    Ok(())
}

/// The vertex that `7`, `7/1/2` or, counted back from the last of `count`, `-2` names.
fn vertex(word: &str, count: usize) -> Result<u32, String> {
    let number = word.split('/').next().unwrap_or_default();
    let number: i64 = number.parse().map_err(|_| format!("{word:?} names no vertex"))?;
    let index = if number < 0 { count as i64 + number } else { number - 1 };
    match u32::try_from(index) {
        Ok(index) if number != 0 => Ok(index),
        _ => Err(format!("{word:?} names a vertex that there is not")),
    }
}
