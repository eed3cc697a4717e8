//! Scene files, beside what reading their bytes and parsing their numbers takes: `cargo bench --bench load`, or
//! `cargo bench --bench load -- SIZE` for a cloth of SIZE × SIZE particles. Medians of processor time on one thread.

use cpu_time::ThreadTime;
use sprung::Scene;
use sprung::scene::builtin::cloth;
use std::hint::black_box;
use std::path::Path;

const REPEATS: usize = 7;

fn main() {
    let argument = std::env::args().skip(1).find_map(|argument| argument.parse().ok());
    let folder = std::env::temp_dir().join(format!("sprung-load-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for the files");
    let size = argument.unwrap_or(300);
    let scene = shaken(size);
    let [json, npz] = ["json", "npz"].map(|ending| folder.join(format!("cloth.{ending}")));
    std::fs::write(&json, scene.to_json()).expect("room on the disk");
    scene.write_npz(std::fs::File::create(&npz).expect("room on the disk")).expect("room on the disk");
    let load = |file: &Path| Scene::load(file).expect("the scene that was written");
    assert!(load(&json).springs == scene.springs && load(&npz).springs == scene.springs);
    drop(scene);
    let mut tasks: [(&str, &dyn Fn()); 3] = [
        ("bytes and numbers of JSON", &|| _ = black_box(numbers(&json))),
        ("JSON", &|| _ = black_box(load(&json))),
        ("NPZ", &|| _ = black_box(load(&npz))),
    ];
    let mut times = [const { Vec::new() }; 3];
    for _ in 0..REPEATS {
        for (times, (_, task)) in times.iter_mut().zip(&mut tasks) {
            let start = ThreadTime::now();
            task();
            times.push(start.elapsed().as_secs_f64());
        }
    }
    times.iter_mut().for_each(|times| times.sort_by(f64::total_cmp));
    let bytes = std::fs::metadata(&json).map_or(0, |file| file.len());
    println!("cloth of {size} × {size}, {:.1} MB of JSON", bytes as f64 * 1e-6);
    for ((name, _), of_task) in tasks.iter().zip(&times) {
        let median = of_task[REPEATS / 2];
        println!("{name}: {:.3} s, {:.2} of the floor", median, median / times[0][REPEATS / 2]);
    }
    std::fs::remove_dir_all(&folder).expect("the folder that was made");
}

/// With coordinates that have all their digits.
fn shaken(size: usize) -> Scene {
    let mut scene = cloth(size).expect("a cloth of that size");
    for (number, row) in scene.particles.positions.iter_mut().enumerate() {
        let moved = row.vector().map(|x| x + 1e-3 * (1.0 + number as f64 * 12.9898 + x).sin());
        *row = <[f64; 3]>::from(moved).into();
    }
    scene
}

/// Reads a file and parses every number in it, by the crate that scenes are read with.
fn numbers(file: &Path) -> f64 {
    let bytes = std::fs::read(file).expect("the file that was written");
    let is_of_number = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
    let mut sum = 0.0;
    for token in bytes.split(|byte| !is_of_number(byte)).filter(|token| token.iter().any(u8::is_ascii_digit)) {
        sum += if token.iter().all(u8::is_ascii_digit) {
            serde_json::from_slice::<u32>(token).map_or(0.0, f64::from)
        } else {
            serde_json::from_slice::<f64>(token).unwrap_or(0.0)
        };
    }
    sum
}
