//! Files written by the library read back to the same numbers, and appear whole or not at all.

use nalgebra::Vector3;
use proptest::prelude::*;
use sprung::force::{Energy, Reactions};
use sprung::integrate::Balance;
use sprung::output::{
    AtomicFile, EnergyLog, Frames, write_dofs, write_final_state, write_frame, write_symmetric, write_vector,
};
use sprung::{Constraint, Error, Motion, Spring, State, System, SystemBuilder};
use std::fs;
use std::io::Write;
use std::num::NonZeroU64;
use std::path::Path;
use vtkio::model::{Attribute, DataSet, Piece, PolyDataPiece, VertexNumbers, Vtk};

/// Three particles, two springs of unequal rest lengths, moving; numbers without a short binary form.
fn triangle(dimension: usize) -> (System, State) {
    let mut builder = SystemBuilder { dimension, ..SystemBuilder::new() };
    for (p, mass) in [0.1, 0.7, 1.3].into_iter().enumerate() {
        let at = |axis: usize| if axis < dimension { (1 + p + 3 * axis) as f64 / 7.0 } else { 0.0 };
        builder.particle([at(0), at(1), at(2)], mass);
        builder.velocities[p] = Vector3::new(-at(2), at(0) / 3.0, 0.0);
        for axis in dimension..3 {
            builder.velocities[p][axis] = 0.0;
        }
    }
    builder.spring(0, 1, Spring { stiffness: 10.0, rest_length: 0.3, damping: 0.0 });
    builder.spring(2, 1, Spring { stiffness: 20.0, rest_length: 0.1, damping: 0.5 });
    builder.build().unwrap()
}

fn strains(system: &System, state: &State) -> Vec<f64> {
    let strain = |(pair, spring): (&[u32; 2], &Spring)| {
        let [i, j] = pair.map(|p| state.positions[p as usize]);
        ((i - j).norm() - spring.rest_length) / spring.rest_length
    };
    system.pairs().iter().zip(system.springs()).map(strain).collect()
}

/// Names of everything in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn an_unfinished_file_leaves_the_older_one_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.txt");
    AtomicFile::write(&target, |file| file.write_all(b"old")).unwrap();

    let mut dropped = AtomicFile::create(&target).unwrap();
    dropped.write_all(&vec![b'x'; 1 << 20]).unwrap();
    drop(dropped);
    let failed = AtomicFile::write(&target, |file| {
        file.write_all(b"half")?;
        Err(std::io::Error::other("stopped"))
    });

    assert_eq!(failed.unwrap_err().to_string(), format!("{}: stopped", target.display()));
    assert_eq!(fs::read_to_string(&target).unwrap(), "old");
    assert_eq!(names(folder.path()), ["a.txt"]);
}

#[test]
fn a_committed_file_replaces_the_older_one_and_folders_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("deep/er/a.txt");
    for text in ["one", "two"] {
        AtomicFile::write(&target, |file| file.write_all(text.as_bytes())).unwrap();
    }
    assert_eq!(fs::read_to_string(&target).unwrap(), "two");
    assert_eq!(names(target.parent().unwrap()), ["a.txt"]);
}

#[cfg(unix)]
#[test]
fn results_have_the_permissions_of_any_other_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
    AtomicFile::write(&ours, |_| Ok(())).unwrap();
    fs::write(&plain, "").unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
}

#[test]
fn a_target_that_cannot_be_is_named_in_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    for target in [folder.path().to_path_buf(), file.join("a.txt")] {
        let error = AtomicFile::create(&target).unwrap_err();
        assert!(matches!(&error, Error::Io { path, .. } if target.starts_with(path)), "{error}");
    }
}

#[test]
fn energies_are_whole_only_when_finished() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("energy.csv");
    let energy = Energy { kinetic: 1e-300, elastic: 1.0 / 3.0, gravitational: -0.1 };
    let mut log = EnergyLog::create(&target).unwrap();
    let balance = Balance { work: 1.0 / 7.0, dissipated: 2e-308, imbalance: -3.5 };
    log.push(0.1 + 0.2, &energy, &balance).unwrap();
    log.push(-0.0, &energy, &balance).unwrap();
    assert!(!target.exists());
    log.finish().unwrap();

    let text = fs::read_to_string(&target).unwrap();
    assert_eq!(text.lines().next(), Some("time,kinetic,elastic,gravitational,total,work,dissipated,imbalance"));
    let rows: Vec<[f64; 8]> = csv::Reader::from_reader(text.as_bytes()).deserialize().map(Result::unwrap).collect();
    let row = |time| [time, 1e-300, 1.0 / 3.0, -0.1, 1e-300 + 1.0 / 3.0 - 0.1, 1.0 / 7.0, 2e-308, -3.5];
    assert_eq!(rows, [row(0.1 + 0.2), row(-0.0)]);
}

/// No number stands where there is none.
#[test]
fn energies_that_are_not_finite_are_left_empty() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("energy.csv");
    let mut log = EnergyLog::create(&target).unwrap();
    let energy = Energy { kinetic: f64::INFINITY, elastic: 1.5, gravitational: f64::NAN };
    log.push(0.5, &energy, &Balance { work: f64::NEG_INFINITY, dissipated: 0.25, imbalance: f64::NAN }).unwrap();
    log.finish().unwrap();
    assert_eq!(fs::read_to_string(&target).unwrap().lines().nth(1), Some("0.5,,1.5,,,,0.25,"));
}

#[test]
fn final_states_have_rows_as_long_as_the_scene_has_axes() {
    let folder = tempfile::tempdir().unwrap();
    for dimension in 1..=3 {
        let (system, mut state) = triangle(dimension);
        state.time = 0.1 + 0.2;
        let target = folder.path().join("final.json");
        write_final_state(&target, "a \"quoted\" name", &system, 7, &state).unwrap();

        let read: serde_json::Value = serde_json::from_str(&fs::read_to_string(&target).unwrap()).unwrap();
        assert_eq!(read["scene"], "a \"quoted\" name");
        assert_eq!(read["time"], 0.1 + 0.2);
        assert_eq!(read["steps"], 7);
        for (key, rows) in [("positions", &state.positions), ("velocities", &state.velocities)] {
            let rows: Vec<&[f64]> = rows.iter().map(|row| &row.as_slice()[..dimension]).collect();
            assert_eq!(read[key], serde_json::json!(rows), "{key} in {dimension} dimensions");
        }
        let reactions = Reactions::at(&system, &state).unwrap();
        assert_eq!(read["reactions"]["particles"], serde_json::json!(reactions.particles));
        let rows: Vec<&[f64]> = reactions.forces.iter().map(|row| &row.as_slice()[..dimension]).collect();
        assert_eq!(read["reactions"]["forces"], serde_json::json!(rows));
    }
}

fn read_frame(path: &Path) -> PolyDataPiece {
    match Vtk::import(path).unwrap().data {
        DataSet::PolyData { pieces, .. } => match pieces.into_iter().next() {
            Some(Piece::Inline(piece)) => *piece,
            other => panic!("{other:?}"),
        },
        other => panic!("{other:?}"),
    }
}

fn numbers(attribute: &Attribute, name: &str) -> Vec<f64> {
    match attribute {
        Attribute::DataArray(array) if array.name == name => array.data.clone().into_vec::<f64>().unwrap(),
        other => panic!("{other:?} is not {name}"),
    }
}

#[test]
fn frames_hold_points_lines_velocities_and_strains() {
    let folder = tempfile::tempdir().unwrap();
    for dimension in 1..=3 {
        let (system, state) = triangle(dimension);
        let target = folder.path().join("frame.vtp");
        write_frame(&target, &system, &state, &[]).unwrap();

        let frame = read_frame(&target);
        let components = |rows: &[Vector3<f64>]| rows.iter().flat_map(|row| [row.x, row.y, row.z]).collect::<Vec<_>>();
        assert_eq!(frame.points.into_vec::<f64>().unwrap(), components(&state.positions));
        assert_eq!(numbers(&frame.data.point[0], "velocity"), components(&state.velocities));
        assert_eq!(numbers(&frame.data.cell[0], "strain"), strains(&system, &state));
        match frame.lines {
            Some(VertexNumbers::XML { connectivity, offsets }) => {
                assert_eq!((connectivity, offsets), (vec![0, 1, 2, 1], vec![2, 4]));
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn frames_keep_triangles_and_name_units() {
    let folder = tempfile::tempdir().unwrap();
    let (system, state) = triangle(3);
    let target = folder.path().join("frame.vtp");
    write_frame(&target, &system, &state, &[[0, 1, 2]]).unwrap();
    let frame = read_frame(&target);
    match frame.polys {
        Some(VertexNumbers::XML { connectivity, offsets }) => {
            assert_eq!((connectivity, offsets), (vec![0, 1, 2], vec![3]));
        }
        other => panic!("{other:?}"),
    }
    // Only side (0, 1) is found as a spring: pairs of a mesh go upwards, (2, 1) does not.
    let springs = strains(&system, &state);
    assert_eq!(numbers(&frame.data.cell[0], "strain"), [springs[0], springs[1], springs[0]]);
    let text = fs::read_to_string(&target).unwrap();
    for unit in ["m", "m/s", "1"] {
        let label = format!("<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">{unit}</InformationKey>");
        assert!(text.contains(&label), "{unit}");
    }
}

#[test]
fn frames_without_springs_or_particles_are_frames_too() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("frame.vtp");
    let mut lone = SystemBuilder::new();
    lone.particle([1.0, 2.0, 3.0], 1.0);
    for (builder, points) in [(SystemBuilder::new(), 0), (lone, 1)] {
        let (system, state) = builder.build().unwrap();
        write_frame(&target, &system, &state, &[]).unwrap();
        assert_eq!(read_frame(&target).num_points(), points);
    }
}

#[test]
fn coincident_ends_have_strain_minus_one() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("frame.vtp");
    let (system, mut state) = triangle(3);
    state.positions[0] = state.positions[1];
    write_frame(&target, &system, &state, &[]).unwrap();
    assert_eq!(numbers(&read_frame(&target).data.cell[0], "strain")[0], -1.0);
}

/// The (timestep, file) entries of a `.pvd` file.
fn series(pvd: &Path) -> Vec<(f64, String)> {
    use quick_xml::events::Event;
    let text = fs::read_to_string(pvd).unwrap();
    let mut reader = quick_xml::Reader::from_str(&text);
    let mut entries = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Event::Empty(element) if element.name().as_ref() == b"DataSet" => {
                let value = |name: &str| {
                    let attribute = element.try_get_attribute(name).unwrap().unwrap();
                    String::from_utf8(attribute.value.into_owned()).unwrap()
                };
                entries.push((value("timestep").parse().unwrap(), value("file")));
            }
            Event::Eof => return entries,
            _ => {}
        }
    }
}

#[test]
fn every_nth_step_is_in_the_series_and_the_series_is_valid_at_any_moment() {
    let folder = tempfile::tempdir().unwrap();
    let pvd = folder.path().join("frames.pvd");
    let (system, mut state) = triangle(2);
    let mut frames = Frames::create(folder.path(), NonZeroU64::new(10).unwrap()).unwrap();
    for step in 0..=1005 {
        state.time = step as f64 * 0.1;
        frames.record(&system, &state, step).unwrap();
        let listed = series(&pvd);
        let written = step as usize / 10 + 1;
        assert!((listed.len()..=listed.len() + listed.len() / 8).contains(&written), "{} of {written}", listed.len());
        assert!(listed.iter().all(|(_, file)| folder.path().join(file).is_file()));
    }
    frames.finish(&system).unwrap();

    let expected: Vec<_> =
        (0..=100).map(|n| ((10 * n) as f64 * 0.1, format!("frames/frame_{:06}.vtp", 10 * n))).collect();
    assert_eq!(series(&pvd), expected);
    assert_eq!(names(&folder.path().join("frames")).len(), 101);
}

#[test]
fn rows_are_numbered_by_particle_then_axis() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("dofs.csv");
    let mut builder = SystemBuilder::new();
    for x in 0..3 {
        builder.particle([x as f64, 0.0, 0.0], 1.0);
    }
    builder.hold(1);
    builder.constrain(Constraint { particles: vec![2], axes: sprung::system::Axes::of(&[1]), motion: Motion::Held });
    write_dofs(&target, builder.build().unwrap().0.dofs()).unwrap();
    assert_eq!(fs::read_to_string(&target).unwrap(), "row,particle,axis\n0,0,x\n1,0,y\n2,0,z\n3,2,x\n4,2,z\n");
}

#[test]
fn rows_of_an_unmovable_scene_are_a_header() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("dofs.csv");
    write_dofs(&target, SystemBuilder::new().build().unwrap().0.dofs()).unwrap();
    assert_eq!(fs::read_to_string(&target).unwrap(), "row,particle,axis\n");
}

#[test]
fn matrices_state_their_size_and_count_from_one() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.mtx");
    write_symmetric(&target, "unit: N/m\nsecond line", 3, 2, [(0, 0, 1.0), (2, 1, -1e-7)]).unwrap();
    let text = fs::read_to_string(&target).unwrap();
    let expected =
        "%%MatrixMarket matrix coordinate real symmetric\n% unit: N/m\n% second line\n3 3 2\n1 1 1.0\n3 2 -1e-7\n";
    assert_eq!(text, expected);
}

#[test]
fn a_matrix_that_breaks_its_announcement_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.mtx");
    for (entries, lower) in [(2, vec![(0, 0, 1.0)]), (1, vec![(0, 1, 1.0)]), (1, vec![(3, 0, 1.0)])] {
        write_symmetric(&target, "", 3, entries, lower).unwrap_err();
        assert!(!target.exists());
    }
}

fn finite() -> impl Strategy<Value = f64> {
    use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

proptest! {
    #[test]
    fn matrix_market_numbers_round_trip(values in prop::collection::vec(finite(), 0..20)) {
        let folder = tempfile::tempdir().unwrap();
        let n = values.len();
        let [matrix, vector] = ["a.mtx", "b.mtx"].map(|name| folder.path().join(name));
        let entries = values.iter().enumerate().map(|(row, &value)| (row, row / 2, value));
        write_symmetric(&matrix, "", n, n, entries).unwrap();
        write_vector(&vector, "", &values).unwrap();

        let bits = |text: &str| text.parse::<f64>().unwrap().to_bits();
        let text = fs::read_to_string(&matrix).unwrap();
        let read: Vec<_> = text.lines().skip(2).map(|line| line.split(' ').collect::<Vec<_>>()).collect();
        prop_assert_eq!(read.len(), n);
        for (row, entry) in read.iter().enumerate() {
            prop_assert_eq!(entry[0], (row + 1).to_string());
            prop_assert_eq!(entry[1], (row / 2 + 1).to_string());
            prop_assert_eq!(bits(entry[2]), values[row].to_bits());
        }
        let text = fs::read_to_string(&vector).unwrap();
        let mut lines = text.lines();
        prop_assert_eq!(lines.next(), Some("%%MatrixMarket matrix array real general"));
        prop_assert_eq!(lines.next().map(str::to_owned), Some(format!("{n} 1")));
        prop_assert_eq!(lines.map(bits).collect::<Vec<_>>(), values.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
    }
}
