//! Meshes: particle i is vertex i, every edge of every face is one spring.

use proptest::prelude::*;
use sprung::scene::{MeshGeometry, Scene};
use std::path::Path;

type PositionsAndPairs = (Vec<[f64; 3]>, Vec<[u32; 2]>);

/// Loads `s.toml`, whose mesh `shape.obj` has this text.
fn build(obj: &str, scale: &str) -> Result<PositionsAndPairs, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("shape.obj"), obj).unwrap();
    let text = format!("particles.masses = 1\nsprings.stiffness = 1\nmesh = {{ file = \"shape.obj\"{scale} }}");
    let path = folder.path().join("s.toml");
    std::fs::write(&path, text).unwrap();
    let built = Scene::load(path).and_then(|scene| scene.build());
    let (system, state) = built.map_err(|error| error.to_string().replace(folder.path().to_str().unwrap(), ""))?;
    Ok((state.positions.iter().map(|&x| x.into()).collect(), system.pairs().to_vec()))
}

#[test]
fn vertices_keep_the_files_order_whatever_the_faces_use_first() {
    let obj = "v 0.1 0 0\nv 1.301895 0 0\nv 0 1 0\nv 9 9 9\nv 0 0 1\nf 5 3 2\nf 3 1 2\n";
    let (positions, pairs) = build(obj, "").unwrap();
    let expected = [[0.1, 0.0, 0.0], [1.301895, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0, 9.0, 9.0], [0.0, 0.0, 1.0]];
    assert_eq!(positions, expected);
    assert_eq!(pairs, [[0, 1], [0, 2], [1, 2], [1, 4], [2, 4]]);
}

#[test]
fn polygons_have_sides_but_no_diagonals() {
    let vertices: String = (0..6).map(|i| format!("v {i} {} 0\n", i * i)).collect();
    let edges = |faces: &str| build(&format!("{vertices}{faces}"), "").unwrap().1;
    assert_eq!(edges("f 1 2 3 4\n"), [[0, 1], [0, 3], [1, 2], [2, 3]]);
    assert_eq!(edges("f 1 2 3 4 5 6\n"), [[0, 1], [0, 5], [1, 2], [2, 3], [3, 4], [4, 5]]);
    assert_eq!(edges("f 1 2 3\nf 3 4 5 6\nf 2 1\n"), [[0, 1], [0, 2], [1, 2], [2, 3], [2, 5], [3, 4], [4, 5]]);
    assert_eq!(edges(""), [[0u32; 2]; 0]);
}

#[test]
fn three_vertices_and_their_face_twice_over() {
    // As many vertices as a triangle has: nothing may mistake the list of vertices for a face.
    assert_eq!(build("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "").unwrap().1, [[0u32; 2]; 0]);
    assert_eq!(build("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2", "").unwrap().1, [[0, 1], [0, 2], [1, 2]]);
}

#[test]
fn coincident_vertices_stay_apart() {
    let (positions, pairs) = build("v 0 0 0\nv 1 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 4\nf 3 2 4\n", "").unwrap();
    assert_eq!(positions[0], positions[2]);
    assert_eq!(pairs, [[0, 1], [0, 3], [1, 2], [1, 3], [2, 3]]);
}

#[test]
fn objects_groups_normals_textures_materials_and_comments_do_not_matter() {
    let obj = "# caf\u{e9}\r\nmtllib none.mtl\r\no one\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nvt 0 0\r\nvn 0 0 1\r\n
        usemtl red\r\nf 1/1/1 2/1/1 3/1/1\r\no two\r\nv 1 1 0\r\ng part\r\nf -1//1 -2//1 -3//1\r\nl 1 4\r\n";
    let (positions, pairs) = build(obj, "").unwrap();
    assert_eq!(positions.len(), 4);
    assert_eq!(pairs, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
}

#[test]
fn bytes_that_are_not_utf8_may_stand_in_comments() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("latin.obj");
    std::fs::write(&path, b"# caf\xe9\nv 0 0 0\nv 1 0 0\nf 1 2\n").unwrap();
    let mesh = MeshGeometry::load(&path).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.edges), (2, vec![[0, 1]]));
}

#[test]
fn faces_become_triangles_and_polygons_fans_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("faces.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 0\nf 2 3 5\nf 1 2 3 4\nf 1 5\n").unwrap();
    let mesh = MeshGeometry::load(&path).unwrap();
    assert_eq!(mesh.triangles, [[1, 2, 4], [0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.edges, [[0, 1], [0, 3], [0, 4], [1, 2], [1, 4], [2, 3], [2, 4]]);
}

#[test]
fn scale_multiplies_the_vertices() {
    assert_eq!(build("v 1 2 3\n", ", scale = 0.5").unwrap().0, [[0.5, 1.0, 1.5]]);
}

#[test]
fn an_empty_mesh_is_refused() {
    let start = "/s.toml: mesh.file = \"shape.obj\": /shape.obj: ";
    assert_eq!(build("", "").unwrap_err(), format!("{start}is empty"));
    let message = build("no mesh\n", "").unwrap_err();
    assert!(message.starts_with(&format!("{start}is no mesh")), "{message}");
}

#[test]
fn nearby_vertices_are_welded_in_metres() {
    let obj = "v 0 0 0\nv 1 0 0\nv 1.001 0 0\nv 2 0 0\nl 1 2\nl 3 4\n";
    let (positions, pairs) = build(obj, ", scale = 10, weld = 0.011").unwrap();
    assert_eq!((positions.len(), pairs), (3, vec![[0, 1], [1, 2]]));
    assert_eq!(build(obj, ", scale = 10, weld = 0.009").unwrap().0.len(), 4);
    let message = build(obj, ", weld = -1").unwrap_err();
    assert!(message.contains("mesh.weld = -1: must not be negative"), "{message}");
}

#[test]
fn wrong_meshes_are_rejected_with_the_line() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (obj, message) in [
        (
            "v 0 0 0\nv 1 0\nf 1 2",
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 2: a vertex has 3 coordinates, and may have a weight and 3 \
             colours: not 2 numbers: \"v 1 0\"",
        ),
        (
            "v 0 0 0\nv 1 zero 0\n",
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 2: \"zero\" is no number: \"v 1 zero 0\"",
        ),
        (
            &format!("{vertices}f 1 2 3\nf 3 2 4\nf 1 2 9"),
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 5: names vertex 4, and the last is 3",
        ),
        (
            &format!("{vertices}f 1 2 0"),
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 4: \"0\" names a vertex that there is not: \"f 1 2 0\"",
        ),
        (
            &format!("{vertices}f 1 2 -4"),
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 4: \"-4\" names a vertex that there is not: \"f 1 2 -4\"",
        ),
        (
            &format!("{vertices}f 1 two 3"),
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 4: \"two\" names no vertex: \"f 1 two 3\"",
        ),
        (
            "v 0 0 0\nv 0 inf 0\n",
            "/s.toml: mesh.file = \"shape.obj\": /shape.obj: line 2: the coordinates [0.0, inf, 0.0] must be finite",
        ),
        (
            "v 0 0 0\nv 0 0 0\nf 1 2",
            "/s.toml: mesh.file = \"shape.obj\": line 3: an edge joins vertices 1 and 2 that lie at one place: a spring of zero current \
             length (mesh.weld = 0 joins such vertices)",
        ),
        (
            "v 1e300 0 0\n",
            "/s.toml: mesh.file = \"shape.obj\": vertex 1 is at [inf, 0.0, 0.0] m: must be at most 1e150 in size",
        ),
    ] {
        assert_eq!(build(obj, ", scale = 1e10").unwrap_err(), message);
    }
}

#[test]
fn a_scale_that_is_not_positive_is_rejected() {
    for (scale, rule) in [("0", "must be positive"), ("-1", "must be positive"), ("inf", "must be finite")] {
        let expected = format!("/s.toml: mesh.scale = {scale}: {rule}");
        assert_eq!(build("v 0 0 0\n", &format!(", scale = {scale}")).unwrap_err(), expected);
    }
}

#[test]
fn a_mesh_that_is_not_there_is_named_with_its_folder() {
    let scene = Scene { file: Some("scenes/s.toml".into()), ..Scene::from_toml("mesh.file = \"none.obj\"").unwrap() };
    let error = scene.build().unwrap_err().to_string();
    let mesh = Path::new("scenes/none.obj");
    assert!(error.starts_with(&format!("scenes/s.toml: mesh.file = \"none.obj\": {}: ", mesh.display())), "{error}");
}

#[test]
fn pairs_beside_a_mesh_are_rejected() {
    let scene = Scene::from_toml("mesh.file = \"none.obj\"\nsprings.pairs = [[0, 1]]").unwrap();
    let expected = "springs.pairs = a list of 1: must be absent: [mesh] fills it";
    assert_eq!(scene.build().unwrap_err().to_string(), expected);
}

proptest! {
    #[test]
    fn any_mesh_is_read_or_rejected(lines in prop::collection::vec("(v|f|f|o|vt|l|) ?(-?[0-9./e ]{0,12}|\\PC{0,8})", 0..12)) {
        let _ = build(&format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{}", lines.join("\n")), "");
    }
}
