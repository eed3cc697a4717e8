use super::MeshGeometry;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write;
use std::path::Path;

fn read(bytes: impl AsRef<[u8]>) -> Result<MeshGeometry, String> {
    MeshGeometry::from_bytes(bytes.as_ref(), Path::new("mesh")).map_err(|error| error.to_string())
}

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [1.0, 1.0, 0.5], [0.0, 1.0, 0.5]];

/// The square as a quadrilateral, whose diagonal is no edge.
fn assert_square(bytes: impl AsRef<[u8]>) {
    let mesh = read(bytes).unwrap();
    assert_eq!(mesh.vertices.iter().map(|&x| x.into()).collect::<Vec<[f64; 3]>>(), SQUARE);
    assert_eq!(mesh.edges, [[0, 1], [0, 3], [1, 2], [2, 3]]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(mesh.notes.is_empty());
}

fn assert_refused(bytes: impl AsRef<[u8]>, message: &str) {
    assert_eq!(read(bytes).unwrap_err(), format!("mesh: {message}"));
}

/// The square's coordinates as words.
fn words() -> String {
    SQUARE.as_flattened().iter().map(|c| format!("{c} ")).collect()
}

fn bytes<T: Copy, const N: usize>(numbers: &[T], order: fn(T) -> [u8; N]) -> Vec<u8> {
    numbers.iter().flat_map(|&number| order(number)).collect()
}

fn doubles(order: fn(f64) -> [u8; 8]) -> Vec<u8> {
    bytes(SQUARE.as_flattened(), order)
}

#[test]
fn obj_has_marks_comments_continuations_and_lines() {
    let vertices = "\u{feff}v 0 0 0.5 # origin\nv 1 0 0.5\r\nv 1 1 0.5 1.0\nv 0 1 0.5\n";
    assert_square(format!("{vertices}f 1 2 3 \\\n 4"));
    assert_square(format!("{vertices}f 1/7/2 2//1 -2 -1 # all"));
    let rope = read(format!("{vertices}l 1 2 3\nl 3 4\nl 4 4")).unwrap();
    assert_eq!((rope.edges.clone(), rope.triangles.len()), (vec![[0, 1], [1, 2], [2, 3]], 0));
    assert_eq!(rope.place(1), "line 5: an edge joins vertices 2 and 3");
    let repeated = read(format!("{vertices}f 1 1 2\nf 1 2 3\nf 2 3 2")).unwrap();
    assert_eq!(repeated.edges, [[0, 1], [0, 2], [1, 2]]);
    let note = "mesh: 2 faces or segments left out (the first is in line 5, which names a vertex twice)";
    assert_eq!(repeated.notes, [note]);
}

/// The last line may be continued into nothing, lines may end in carriage returns alone, and words left over are no vertex's.
#[test]
fn every_statement_of_obj_counts() {
    let vertices = "v 0 0 0.5\nv 1 0 0.5 1\nv 1 1 0.5 0.1 0.2 0.3\nv 0 1 0.5 0.1 0.2 0.3 1\n";
    assert_square(format!("{vertices}f 1 2 3 4 \\"));
    assert_square(format!("{vertices}f 1 2 3 4 \\\n"));
    assert_square(format!("{vertices}f 1 2 3 4\n").replace('\n', "\r"));
    assert_square(format!("{vertices}f 1 2 3 4\n").replace('\n', "\r\n"));
    assert_refused("v 0 0 0\nv 0 0 0 v\n", "line 2: \"v\" is no number: \"v 0 0 0 v\"");
    let rule = "a vertex has 3 coordinates, and may have a weight and 3 colours: not";
    for (vertex, count) in [("v 0 0", 2), ("v 0 0 0 1 2", 5), ("v 0 0 0 1 1 1 1 1", 8)] {
        assert_refused(format!("v 0 0 0\n{vertex}\n"), &format!("line 2: {rule} {count} numbers: {vertex:?}"));
    }
    let omitted = read(format!("{vertices}f 1\nl 1 1\nl 2\nl 1 2")).unwrap();
    assert_eq!(omitted.edges, [[0, 1]]);
    let note = "mesh: 3 faces or segments left out (the first is in line 5, which names fewer than two vertices)";
    assert_eq!(omitted.notes, [note]);
}

/// What is wrong is named by its place and its value.
#[test]
fn wrong_vertices_are_named() {
    let stl = "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 1e999 0\n";
    assert_refused(stl, "line 4: the coordinates [0.0, inf, 0.0] must be finite");
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n0 0 3 4\n";
    assert_refused(format!("{ply}3 0 1 -1"), "face 0: names vertex -1, which there is not");
    assert_refused(format!("{ply}3 0 1 7"), "face 0: names vertex 7, and the last is 1");
    assert_refused("$NOD\n1\n1 0 0 0\n$ENDNOD\n", "line 1: MSH 1 is not read: 2, 4.0 and 4.1 are");
    let vtk = "# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 50000000000 float\n";
    assert_refused(vtk, "line 5: 50000000000 is no count or index: a whole number from 0 to 4294967294 is wanted");
}

/// A binary STL file is known by its length: one of another length says so.
#[test]
fn lengths_of_binary_stl_are_compared() {
    let none = "is no mesh: neither OBJ (no line begins with v), PLY, STL, VTK nor Gmsh MSH";
    for (facets, bytes, state) in [
        (2u32, 60, "; as binary STL it is truncated: 2 facets need 184 bytes, and it has 144"),
        (1, 0, "; as binary STL it is truncated: 1 facet needs 134 bytes, and it has 84"),
        (2, 103, "; as binary STL it goes on after its last facet: 2 facets need 184 bytes, and it has 187"),
        (0, 0, "; as binary STL it is empty: it counts 0 facets"),
    ] {
        for name in [&b"solid"[..], b"exported"] {
            let mut file = name.to_vec();
            file.resize(80, 0);
            file.extend(facets.to_le_bytes());
            file.resize(84 + bytes, 0);
            assert_refused(file, &format!("{none}{state}"));
        }
    }
}

#[test]
fn ply_is_read_as_text_and_binary() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment none\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
             element face 1\nproperty uchar red\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    assert_square(format!("{}{}\n255 4 0 1 2 3\n", header("ascii"), words()));
    let binary = |format: &str, double: fn(f64) -> [u8; 8], int: fn(i32) -> [u8; 4]| {
        [header(format).as_bytes(), &doubles(double), &[255, 4], &bytes(&[0, 1, 2, 3], int)].concat()
    };
    let little = binary("binary_little_endian", f64::to_le_bytes, i32::to_le_bytes);
    assert_square(&little);
    assert_square(binary("binary_big_endian", f64::to_be_bytes, i32::to_be_bytes));
    assert_refused(&little[..little.len() - 1], "line 12: binary data end too early");
    let edges = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nelement edge 1\nproperty int vertex1\n\
                 property int vertex2\nend_header\n0 0 3 4 0 1";
    let edges = read(edges).unwrap();
    assert_eq!((edges.edges.clone(), edges.vertices[1]), (vec![[0, 1]], nalgebra::Vector3::new(3.0, 4.0, 0.0)));
}

fn facet(corners: &[[f64; 3]]) -> String {
    let vertices: String = corners.iter().map(|[x, y, z]| format!("vertex {x} {y} {z}\n")).collect();
    format!("facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n")
}

#[test]
fn facets_of_stl_share_corners() {
    let corners = |facet: [usize; 3]| facet.map(|corner| SQUARE[corner]);
    let facets = [corners([0, 1, 2]), corners([0, 2, 3]), corners([1, 1, 2])];
    let text = format!("solid two words\n{}endsolid two words\n", facets.map(|corners| facet(&corners)).concat());
    let numbers = |facet: &[[f64; 3]; 3]| -> Vec<u8> {
        let all: Vec<f64> = [&[0.0, 0.0, 1.0], facet.as_flattened()].concat();
        [bytes(&all, |c| (c as f32).to_le_bytes()), vec![0, 0]].concat()
    };
    // Many binary files begin as those of text do.
    let mut binary = b"solid".to_vec();
    binary.resize(80, 0);
    binary.extend(3u32.to_le_bytes());
    facets.iter().for_each(|facet| binary.extend(numbers(facet)));
    for (bytes, place) in [(text.into_bytes(), "line 21"), (binary, "facet 2")] {
        let mesh = read(bytes).unwrap();
        assert_eq!((mesh.vertices.len(), mesh.edges.len(), mesh.triangles.len()), (4, 5, 2));
        assert_eq!(mesh.notes, [format!("mesh: 1 face or segment left out (in {place}, which names a vertex twice)")]);
    }
}

/// A facet is a triangle, and a file ends with `endsolid`.
#[test]
fn facets_of_stl_have_three_corners() {
    let triangle = facet(&SQUARE[..3]);
    let file = |count: usize| format!("solid s\n{triangle}{}endsolid s\n", facet(&SQUARE[..count]));
    assert!(read(file(3)).is_ok() && read(file(3).repeat(2)).is_ok());
    for (count, line) in [(0, 11), (2, 13), (4, 15)] {
        assert_refused(file(count), &format!("line {line}: a facet has 3 vertices, not {count}"));
    }
    assert_refused(format!("solid s\n{triangle}"), "line 9: the file ends without endsolid");
}

#[test]
fn legacy_vtk_is_read_in_all_versions() {
    let start = |version: &str, kind: &str, data: &str| {
        format!("# vtk DataFile Version {version}\ntitle\n{kind}\nDATASET {data}\nPOINTS 4 double\n")
    };
    let grid = start("3.0", "ASCII", "UNSTRUCTURED_GRID");
    assert_square(format!("{grid}{}\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9\nCELL_DATA 1\nanything", words()));
    assert_square(format!("{grid}{}\nCELLS 1 5\n4 0 1 3 2\nCELL_TYPES 1\n8\n", words()));
    assert_square(format!("{}{}\nPOLYGONS 1 5\n4 0 1 2 3\n", start("2.0", "ASCII", "POLYDATA"), words()));
    let five = start("5.1", "ASCII", "UNSTRUCTURED_GRID");
    assert_square(format!(
        "{five}{}\nCELLS 2 4\nOFFSETS vtktypeint64\n0 4\nCONNECTIVITY vtktypeint64\n0 1 2 3\nCELL_TYPES 1\n9",
        words()
    ));
    let (beginning, places) = (start("3.0", "BINARY", "UNSTRUCTURED_GRID"), doubles(f64::to_be_bytes));
    let (cell, kind) = (bytes(&[4, 0, 1, 2, 3], i32::to_be_bytes), bytes(&[9], i32::to_be_bytes));
    let binary =
        [beginning.as_bytes(), &places, b"\nMETADATA\nINFORMATION 0\n\nCELLS 1 5\n", &cell, b"\nCELL_TYPES 1\n", &kind];
    assert_square(binary.concat());
    let solid = format!("{grid}{}\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n", words());
    assert_eq!(read(&solid).unwrap().edges.len(), 6);
    let curved = "cell 0 is of type 24: only cells with straight edges are read";
    assert_refused(solid.replace("\n10\n", "\n24\n"), curved);
    assert_refused(solid.replace("4 0 1 2 3", "4 0 1 2 9"), "cell 0: names vertex 9, and the last is 3");
}

#[test]
fn xml_of_vtk_is_read_however_it_is_encoded() {
    let file = |attributes: &str, arrays: [&str; 4], tail: &str| {
        let [points, corners, ends, types] = arrays;
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"{attributes}><UnstructuredGrid>\
             <Piece NumberOfPoints=\"4\" NumberOfCells=\"1\"><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" {points}</DataArray></Points>\
             <Cells><DataArray type=\"Int64\" Name=\"connectivity\" {corners}</DataArray><DataArray type=\"Int64\" Name=\"offsets\" {ends}</DataArray>\
             <DataArray type=\"UInt8\" Name=\"types\" {types}</DataArray></Cells></Piece></UnstructuredGrid>{tail}</VTKFile>"
        )
    };
    let text = |numbers: &str| format!("format=\"ascii\">{numbers}");
    let arrays = [&*text(&words()), &*text("0 1 2 3"), &*text("4"), &*text("9")];
    assert_square(file("", arrays, ""));
    let corners = bytes(&[0, 1, 2, 3], i64::to_le_bytes);
    let data = [doubles(f64::to_le_bytes), corners, bytes(&[4], i64::to_le_bytes), vec![9]];
    let plain = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    let encoded = data.clone().map(|bytes| format!("format=\"binary\">{}", BASE64_STANDARD.encode(plain(&bytes))));
    assert_square(file("", encoded.each_ref().map(String::as_str), ""));
    // One block each, the lengths of blocks in base64 of their own.
    let packed = data.clone().map(|array| {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&array).unwrap();
        let packed = encoder.finish().unwrap();
        let header = bytes(&[1, array.len() as u64, 0, packed.len() as u64], u64::to_le_bytes);
        format!("format=\"binary\">\n  {}{}\n", BASE64_STANDARD.encode(header), BASE64_STANDARD.encode(packed))
    });
    let attributes = " header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";
    assert_square(file(attributes, packed.each_ref().map(String::as_str), ""));
    // Appended as it is, with bytes that are no XML.
    let mut offset = 0;
    let offsets = data.each_ref().map(|bytes| {
        let array = format!("format=\"appended\" offset=\"{offset}\">");
        offset += bytes.len() + 4;
        array
    });
    let whole = file("", offsets.each_ref().map(String::as_str), "<AppendedData encoding=\"raw\">_");
    let start = &whole.as_bytes()[..whole.len() - "</VTKFile>".len()];
    assert_square([start, &data.each_ref().map(|bytes| plain(bytes)).concat(), b"</AppendedData></VTKFile>"].concat());
    for (count, found, wrong) in [("NumberOfPoints", 4, 6), ("NumberOfCells", 1, 2)] {
        let changed = file("", arrays, "").replace(&format!("{count}=\"{found}"), &format!("{count}=\"{wrong}"));
        assert_refused(changed, &format!("{count} is {wrong}, and its arrays have {found}"));
    }
    assert_refused("<html></html>", "is no mesh: XML, but no VTKFile");
}

#[test]
fn gmsh_is_read_in_versions_two_and_four() {
    let nodes = |tags: [u32; 4]| -> String {
        tags.iter().zip(SQUARE).map(|(tag, [x, y, z])| format!("{tag} {x} {y} {z}\n")).collect()
    };
    // Tags need not be dense, and names of groups may come first.
    let two = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 \"all\"\n$EndPhysicalNames\n$Nodes\n4\n{}$EndNodes\n\
         $Elements\n2\n1 15 2 0 1 7\n2 3 2 0 1 7 8 9 20\n$EndElements\n",
        nodes([7, 8, 9, 20])
    );
    assert_square(&two);
    let missing = "element 2 names node 21, which there is not";
    assert_refused(two.replace("8 9 20\n$End", "8 9 21\n$End"), missing);
    let curved = "element 2 is of type 9: only elements with straight edges are read";
    assert_refused(two.replace("2 3 2 0 1", "2 9 2 0 1"), curved);
    let places: String = SQUARE.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    assert_square(format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 1 0\n$EndEntities\n$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n{places}$EndNodes\n\
         $Elements\n1 1 1 1\n2 1 3 1\n1 1 2 3 4\n$EndElements\n"
    ));
    assert_square(format!(
        "$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n1 4\n1 2 0 4\n{}$EndNodes\n$Elements\n1 1\n1 2 3 1\n1 1 2 3 4\n$EndElements\n",
        nodes([1, 2, 3, 4])
    ));
    let ints = |numbers: &[i32]| bytes(numbers, i32::to_le_bytes);
    let sizes = |numbers: &[u64]| bytes(numbers, u64::to_le_bytes);
    let format = |version: &str| {
        [b"$MeshFormat\n", version.as_bytes(), b" 1 8\n", &ints(&[1]), b"\n$EndMeshFormat\n$Nodes\n"].concat()
    };
    let node = |(tag, x): (i32, &[f64; 3])| [ints(&[tag]), bytes(x, f64::to_le_bytes)].concat();
    let of_two: Vec<u8> = (1..).zip(&SQUARE).flat_map(node).collect();
    let elements = ints(&[3, 1, 2, 1, 0, 0, 1, 2, 3, 4]);
    assert_square(
        [&format("2.2")[..], b"4\n", &of_two, b"\n$EndNodes\n$Elements\n1\n", &elements, b"\n$EndElements\n"].concat(),
    );
    let counts = [sizes(&[1, 4, 1, 4]), ints(&[2, 1, 0]), sizes(&[4, 1, 2, 3, 4])].concat();
    let element = [sizes(&[1, 1, 1, 1]), ints(&[2, 1, 3]), sizes(&[1, 1, 1, 2, 3, 4])].concat();
    let (beginning, places) = (format("4.1"), doubles(f64::to_le_bytes));
    let four = [&beginning[..], &counts, &places, b"\n$EndNodes\n$Elements\n", &element, b"\n$EndElements\n"];
    assert_square(four.concat());
}

/// Solid elements have as many edges as their kind, three at every corner and four at the top of a pyramid.
#[test]
fn solids_become_their_edges() {
    let corners: String = (0..8).map(|c| format!("{} {} {}\n", (c ^ c >> 1) & 1, c >> 1 & 1, c >> 2)).collect();
    for (kind, count, edges) in [(10, 4, 6), (12, 8, 12), (11, 8, 12), (13, 6, 9), (14, 5, 8)] {
        let cell: String = (0..count).map(|c| format!(" {c}")).collect();
        let text = format!(
            "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n{corners}CELLS 1 {}\n{count}{cell}\nCELL_TYPES 1\n{kind}\n",
            count + 1
        );
        let mesh = read(text).unwrap();
        assert_eq!((mesh.edges.len(), mesh.triangles.len()), (edges, 0), "{kind}");
        let at = |corner: u32| mesh.edges.iter().flatten().filter(|&&end| end == corner).count();
        let is_top = |corner: u32| kind == 14 && corner == 4;
        assert!((0..count).all(|corner| at(corner) == if is_top(corner) { 4 } else { 3 }), "{kind}");
        if kind == 12 {
            let lengths =
                mesh.edges.iter().map(|&[i, j]| (mesh.vertices[i as usize] - mesh.vertices[j as usize]).norm());
            assert!(lengths.into_iter().all(|length| length == 1.0));
        }
    }
}

/// What is none of the formats is said to be none; what is cut short, anywhere, is refused or read, and breaks nothing.
#[test]
fn what_is_no_mesh_is_refused() {
    for bytes in [&b"hello"[..], b"\x7fELF\x02\x01\x01\x00\x00", b"", b" \n", b"{\"a\": 1}", b"f 1 2 3"] {
        let message = read(bytes).unwrap_err();
        assert!(message.starts_with("mesh: is"), "{message}");
    }
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\nend_header\n{}",
        words()
    );
    for end in 0..ply.len() {
        let _ = read(&ply[..end]);
    }
    assert!(read(ply.replace("vertex 4", "vertex 99999999999999")).is_err());
}

#[test]
fn vertices_are_welded_and_surprises_noted() {
    let mut mesh = read("v 0 0 0\nv 1 0 0\nv 1.01 0 0\nv 2 0 0\nv 9 9 9\nf 1 2 3\nl 3 4\nl 2 4").unwrap();
    mesh.weld(0.02);
    assert_eq!((mesh.vertices.len(), mesh.edges.clone(), mesh.triangles.len()), (4, vec![[0, 1], [1, 2]], 0));
    assert_eq!(mesh.vertices[1].x, 1.0);
    mesh.add_notes();
    let expected = ["mesh.weld joins 5 vertices to 4", "particle 3 is in no edge: it moves on its own"];
    assert_eq!(mesh.notes, expected);
    let mut apart = read("v 0 0 0\nv 1 0 0\nv -0 0 0\nv 0 1 0\nl 1 2\nl 3 4").unwrap();
    apart.add_notes();
    let expected = [
        "the mesh is 2 loose parts, which no edge joins",
        "1 vertex lies where another does; mesh.weld = 0 joins them",
    ];
    assert_eq!(apart.notes, expected);
    apart.weld(0.0);
    assert_eq!((apart.vertices.len(), apart.edges), (3, vec![[0, 1], [0, 2]]));
}
