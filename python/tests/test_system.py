"""Systems from arrays of any kind, from files, and what they refuse."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
import sprung
from conftest import ROOT, tangle


def arrays(system: sprung.System):
    return system.masses, system.pairs, system.stiffness, system.rest_lengths, system.damping, system.gravity


def same(a: sprung.System, b: sprung.System) -> None:
    for one, other in zip(arrays(a), arrays(b)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(a.dofs, b.dofs)
    for one, other in ((a.initial_state(), b.initial_state()),):
        np.testing.assert_array_equal(one.positions, other.positions)
        np.testing.assert_array_equal(one.velocities, other.velocities)


TRIANGLE = dict(
    positions=[[0, 0, 0], [1, 0, 0], [1, 2, 0]],
    pairs=[[0, 1], [1, 2]],
    masses=[1, 2, 3],
    stiffness=[10, 20],
    rest_lengths=[1, 1],
    damping=[0, 1],
)


@pytest.mark.parametrize("dtype", ["f8", "f4", "f2", ">f8", "g", "i1", "i8", "u2", ">i4"])
def test_any_real_type_gives_the_same_system(dtype):
    changed = {key: np.array(value, dtype=dtype) for key, value in TRIANGLE.items() if key != "pairs"}
    integers = dtype if np.dtype(dtype).kind in "iu" else "u8"
    same(sprung.System(**changed, pairs=np.array(TRIANGLE["pairs"], integers)), sprung.System(**TRIANGLE))


def test_any_layout_gives_the_same_system():
    positions = np.array(TRIANGLE["positions"], float)
    wide = np.zeros((6, 6))
    wide[::2, ::2] = positions
    reversed_pairs = np.array(TRIANGLE["pairs"])[::-1][::-1]
    for layout in (np.asfortranarray(positions), wide[::2, ::2], positions[::-1][::-1], positions.copy()[:, ::-1][:, ::-1]):
        layout.flags.writeable = False
        changed = {**TRIANGLE, "positions": layout, "pairs": np.asfortranarray(reversed_pairs), "masses": np.arange(1, 7, 2)[[0, 0, 1]] * [1, 2, 1]}
        same(sprung.System(**changed), sprung.System(**TRIANGLE))


def test_scalars_stand_for_all_and_absent_rest_lengths_for_distances():
    system = sprung.System([[0, 0], [3, 4]], [[0, 1]], masses=2, stiffness=np.float32(5))
    assert (system.dimension, system.rest_lengths[0], system.damping[0], list(system.masses)) == (2, 5.0, 0.0, [2.0, 2.0])


def test_initial_states_are_the_users_own(system):
    state = system.initial_state()
    state.positions += 1.0
    assert (system.initial_state().positions != state.positions).all()
    assert state.positions is state.positions and state.positions.flags.writeable


def test_files_hold_systems_to_the_bit(system, tmp_path):
    for name in ("scene.toml", "scene.json", "scene.npz"):
        system.save(tmp_path / name)
        same(sprung.System.load(tmp_path / name), system)
    same(sprung.System.parse(system.to_toml()), system)
    same(pickle.loads(pickle.dumps(system)), system)


def test_meshes_load():
    system = sprung.System.load(ROOT / "verification/scenes/bunny.toml")
    assert len(system.masses) == 1839 and "iframe" in system._repr_html_()


@pytest.mark.parametrize("kind", ["chain", "cloth", "lattice", "column", "pendulum", "string", "network"])
def test_ready_scenes(kind):
    assert sprung.System.ready(kind).name == kind


def test_constraints_are_those_of_scene_files():
    positions = np.eye(3)
    by_class = [
        sprung.Constraint([0], axes=["x", "z"], velocity=[1, 0, 2]),
        sprung.Constraint(2, path=([0, 1], [[0, 0, 0], [0, 1, 0]])),
    ]
    by_mapping = [
        {"particles": [0], "axes": "xz", "velocity": (1, 0, 2)},
        {"particles": np.array([2]), "path": {"times": [0, 1], "offsets": [[0, 0, 0], [0, 1, 0]]}},
    ]
    a, b = (sprung.System(positions, masses=1.0, constraints=given) for given in (by_class, by_mapping))
    same(a, b)
    assert a.dofs.tolist() == [[0, 1], [1, 0], [1, 1], [1, 2]]
    assert a.initial_state().velocities.tolist() == [[1, 0, 2], [0, 0, 0], [0, 1, 0]]
    written = json.loads(a.to_json())["constraints"]
    assert written == json.loads(b.to_json())["constraints"] and len(written) == 2


REFUSED = {
    "masses[1] = -2: must be finite and positive": dict(masses=[1, -2, 3]),
    "masses[2] = NaN: must be finite and positive": dict(masses=[1, 1, np.nan]),
    "masses = -1.0: must be finite and positive": dict(masses=-1),
    "masses = an array of shape (2,): must be one number, or one for each of the 3 particles": dict(masses=[1, 2]),
    "masses = an array of complex128": dict(masses=[1j, 1, 1]),
    "masses = an array of <U1": dict(masses=["a", "b", "c"]),
    "masses = an array of object": dict(masses=[None, 1, 1]),
    "stiffness[1] = 0: must be finite and positive": dict(stiffness=[1, 0]),
    "stiffness: must be given": dict(stiffness=None),
    "rest_lengths[0] = inf": dict(rest_lengths=[np.inf, 1]),
    "damping[1] = -0.5": dict(damping=[0, -0.5]),
    "damping = -1.0: must be finite and not negative": dict(damping=-1),
    "positions[1] = [NaN, 0.0, 0.0]: must be finite": dict(positions=[[0, 0, 0], [np.nan, 0, 0], [1, 2, 0]]),
    "positions = an array of shape (3,)": dict(positions=[0, 1, 2]),
    "positions = an array of shape (3, 4)": dict(positions=np.zeros((3, 4))),
    "positions: ": dict(positions=[[0, 0, 0], [1, 0], [1, 2, 0]]),
    "pairs[1] = [1, 3]: names a particle that does not exist (there are 3)": dict(pairs=[[0, 1], [1, 3]]),
    "pairs[0] = [-1, 1]: names a particle that does not exist (there are 3)": dict(pairs=[[-1, 1], [1, 2]]),
    "pairs[1] = [2, 2]: joins a particle to itself": dict(pairs=[[0, 1], [2, 2]]),
    "pairs = an array of float64: must be an array of integers": dict(pairs=[[0.0, 1.0], [1, 2]]),
    "pairs = an array of shape (2, 3)": dict(pairs=[[0, 1, 2], [0, 1, 2]]),
    "pairs[0] = [0, 1]: is a spring of zero current length": dict(positions=[[0, 0, 0], [0, 0, 0], [1, 2, 0]]),
    "velocities[2] = [inf, 0.0, 0.0]": dict(velocities=[[0, 0, 0], [0, 0, 0], [np.inf, 0, 0]]),
    "velocities = an array of shape (2, 3)": dict(velocities=np.zeros((2, 3))),
    "gravity = [0.0, NaN, 0.0]": dict(gravity=[0, np.nan, 0]),
    "gravity = an array of shape (2,)": dict(gravity=[0, -9.81]),
    "constraints[0] = 3: must be a Constraint or a mapping": dict(constraints=[3]),
    "constraints[0] = 'axis': unknown key": dict(constraints=[{"particles": 0, "axis": "x"}]),
    "constraints[0].particles: must be given": dict(constraints=[{"axes": "x"}]),
    "constraints[1].particles[1] = 7": dict(constraints=[sprung.Constraint(0), sprung.Constraint([1, 7])]),
    "constraints[0].particles[0] = -1": dict(constraints=[sprung.Constraint(-1)]),
    "constraints[0].axes[1] = 'w'": dict(constraints=[sprung.Constraint(0, axes="xw")]),
    "constraints[0] = velocity and path": dict(
        constraints=[sprung.Constraint(0, velocity=[0, 0, 0], path=([0], [[0, 0, 0]]))]
    ),
    "constraints[0].velocity = an array of shape (2,)": dict(constraints=[sprung.Constraint(0, velocity=[0, 0])]),
    "constraints[0].path.times[1] = 1": dict(
        constraints=[sprung.Constraint(0, path=([1, 1], [[0, 0, 0], [0, 0, 0]]))]
    ),
    "constraints[0].path = ['times']": dict(constraints=[sprung.Constraint(0, path={"times": [0]})]),
    "constraints[0].path.offsets = a list of 1": dict(constraints=[sprung.Constraint(0, path=([0, 1], [[0, 0, 0]]))]),
}


@pytest.mark.parametrize("message", REFUSED)
def test_unusable_values_are_named(message):
    with pytest.raises(ValueError) as raised:
        sprung.System(**{**TRIANGLE, **REFUSED[message]})
    assert str(raised.value).startswith(message)


def test_unusable_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError) as missing:
        sprung.System.load(tmp_path / "none.toml")
    assert missing.value.filename.endswith("none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("[particles]\npositions = [[0]]\nmasses = [-1]\n")
    with pytest.raises(ValueError, match=r"broken.toml: particles.masses\[0\] = -1: must be finite and positive"):
        sprung.System.load(broken)
    with pytest.raises(ValueError, match="must end in .toml, .json or .npz"):
        sprung.System.load(tmp_path / "scene.yaml")
    with pytest.raises(ValueError, match="must end in .toml, .json or .npz"):
        tangle().save(tmp_path / "scene.yaml")
    with pytest.raises(ValueError, match='format = "yaml"'):
        sprung.System.parse("", "yaml")
    with pytest.raises(ValueError, match='kind = "sphere": must be one of chain, '):
        sprung.System.ready("sphere")
    with pytest.raises(ValueError, match="size = 0: must be a positive integer"):
        sprung.System.ready("cloth", 0)


def test_unusable_states_are_named(system):
    n, dimension = len(system.masses), system.dimension
    for change, message in (
        (lambda state: state.positions.__setitem__((4, 0), np.nan), r"positions\[4\] = \[NaN"),
        (lambda state: state.velocities.__setitem__((2, 0), np.inf), r"velocities\[2\] = \[inf"),
        (lambda state: setattr(state, "positions", state.positions[1:]), f"positions = an array of {n - 1} × {dimension}"),
        (lambda state: setattr(state, "velocities", None), "velocities = an array of object"),
        (lambda state: setattr(state, "time", np.nan), "time = NaN: must be finite"),
        (lambda state: setattr(state, "time", "now"), "time = an array of <U3"),
    ):
        state = system.initial_state()
        change(state)
        with pytest.raises(ValueError, match=message):
            system.force(state)
    for call in (sprung.inspect, sprung.equilibrium, sprung.mechanisms):
        with pytest.raises(TypeError, match="state = 5: must be a sprung.State, or None for the initial one"):
            call(system, 5)


def test_forces_and_energies_are_those_of_the_formulas(system):
    state = system.initial_state()
    i, j = system.pairs.T.astype(int)
    d = state.positions[i] - state.positions[j]
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    strain = (length - system.rest_lengths) / system.rest_lengths
    expected = np.zeros_like(state.positions)
    pull = -(system.stiffness * strain)[:, None] * n
    drag = -(system.damping * (n * (state.velocities[i] - state.velocities[j])).sum(axis=1))[:, None] * n
    for part in (pull, drag):
        np.add.at(expected, i, part)
        np.add.at(expected, j, -part)
    expected += system.masses[:, None] * system.gravity
    # Each entry is a sum of some twenty terms of a few roundings each: some hundred roundings of the largest.
    allowed = 100 * 1.1e-16 * abs(pull).max()
    np.testing.assert_allclose(system.force(state), expected, rtol=0, atol=allowed)
    parts = sum(system.force(state, kind) for kind in ("elastic", "damping", "weight"))
    np.testing.assert_allclose(system.force(state), parts, rtol=0, atol=allowed)
    energy = system.energy(state)
    kinetic = 0.5 * (system.masses * (state.velocities**2).sum(axis=1)).sum()
    elastic = 0.5 * (system.stiffness * system.rest_lengths * strain**2).sum()
    np.testing.assert_allclose([energy.kinetic, energy.elastic], [kinetic, elastic], rtol=1e-13)
    assert energy.total == sum(energy)
    with pytest.raises(ValueError, match='kind = "magnetic"'):
        system.force(state, "magnetic")


def test_gather_and_scatter_are_inverse(system):
    full = np.arange(float(len(system.masses) * system.dimension)).reshape(-1, system.dimension)
    reduced = system.gather(full)
    np.testing.assert_array_equal(system.scatter(reduced, full), full)
    np.testing.assert_array_equal(system.gather(system.scatter(reduced)), reduced)


def test_constraints_act_with_what_the_motion_needs():
    arrays = dict(positions=[[0, 0], [0, -1]], pairs=[[0, 1]], masses=[1, 2], stiffness=20, rest_lengths=0.5, gravity=[0, -10])
    system = sprung.System(**arrays, constraints=[{"particles": [0]}])
    # Its own weight and the pull of the spring, which is as long again as at rest.
    np.testing.assert_allclose(system.reactions(), [[0, 30], [0, 0]], rtol=1e-15)
    result = sprung.Stepper(system).run(0.1)
    np.testing.assert_array_equal(result.reactions, system.reactions(result.state))


@pytest.mark.parametrize("size", [-3, 0, 2.5, True])
def test_ready_scenes_have_a_size(size):
    with pytest.raises(ValueError, match="size = .*: must be a positive integer"):
        sprung.System.ready("cloth", size)


def test_ready_scenes_are_refined():
    coarse, fine = sprung.System.ready("cloth", 20), sprung.System.ready("cloth", 39, refine=True)
    widths = [np.ptp(system.initial_state().positions, axis=0) for system in (coarse, fine)]
    np.testing.assert_allclose(*widths, rtol=1e-12)


@pytest.mark.filterwarnings("ignore:.* in no edge")
def test_meshes_of_meshio(tmp_path):
    meshio = pytest.importorskip("meshio", reason="meshio is not installed: its meshes were not read")
    points = np.random.default_rng(0).normal(size=(14, 3))
    cells = [("triangle", [[0, 1, 2], [2, 1, 3]]), ("line", [[3, 4], [4, 3]]), ("vertex", [[13]]), ("tetra", [[4, 5, 6, 7]])]
    mesh = meshio.Mesh(points, cells)
    edges = [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3], [3, 4], [4, 5], [4, 6], [4, 7], [5, 6], [5, 7], [6, 7]]
    mesh.write(tmp_path / "mesh.vtk")
    for given in (mesh, tmp_path / "mesh.vtk", str(tmp_path / "mesh.vtk")):
        system = sprung.System.from_meshio(given, masses=2.0, stiffness=3.0, constraints=[sprung.Constraint(0)])
        assert system.pairs.tolist() == edges
        np.testing.assert_array_equal(system.initial_state().positions, points)
        lengths = np.linalg.norm(points[system.pairs[:, 0]] - points[system.pairs[:, 1]], axis=1)
        np.testing.assert_allclose(system.rest_lengths, lengths, rtol=1e-15)
    # A cube has 12 edges, a quadrilateral its four sides and no diagonal, a wedge nine edges, a pyramid eight.
    corners = {"hexahedron": (8, 12), "quad": (4, 4), "wedge": (6, 9), "pyramid": (5, 8), "polygon": (7, 7)}
    for kind, (count, edges) in corners.items():
        mesh = meshio.Mesh(points, [(kind, [list(range(count))])])
        pairs = sprung.System.from_meshio(mesh, masses=1.0, stiffness=1.0).pairs
        assert len(pairs) == edges and set(pairs.ravel()) == set(range(count)), kind
        degrees = np.bincount(pairs.ravel(), minlength=count)
        assert degrees.max() == {"hexahedron": 3, "quad": 2, "wedge": 3, "pyramid": 4, "polygon": 2}[kind]
    # No edge of a cube joins corners that are not neighbours.
    cube = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    mesh = meshio.Mesh(cube, [("hexahedron", [list(range(8))])])
    np.testing.assert_array_equal(sprung.System.from_meshio(mesh, masses=1.0, stiffness=1.0).rest_lengths, 1.0)
    with pytest.raises(ValueError, match="the mesh: cells of type 'triangle6'"):
        sprung.System.from_meshio(meshio.Mesh(points, [("triangle6", [list(range(6))])]), masses=1.0)


def test_meshes_of_meshio_that_surprise(tmp_path, monkeypatch):
    meshio = pytest.importorskip("meshio", reason="meshio is not installed: its meshes were not read")
    points = np.array([[0, 0, 0], [1, 0, 0], [1.001, 0, 0], [2, 0, 0], [2, 0, 0], [9, 9, 9.0]])
    mesh = meshio.Mesh(points, [("line", [[0, 1], [2, 3]])])
    with pytest.warns(UserWarning) as found:
        system = sprung.System.from_meshio(mesh, masses=1.0, stiffness=1.0)
    assert [str(one.message) for one in found] == [
        "the mesh is 2 loose parts, which no edge joins",
        "1 vertex lies where another does; weld = 0 joins them",
        "2 particles are in no edge (the first is 4): they move on their own",
    ]
    assert {one.filename for one in found} == {__file__} and len(system.masses) == 6
    with pytest.warns(UserWarning, match="particle 3 is in no edge"):
        system = sprung.System.from_meshio(mesh, masses=1.0, stiffness=1.0, weld=0.01)
    assert system.pairs.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_array_equal(system.initial_state().positions, points[[0, 1, 3, 5]])
    with pytest.raises(ValueError, match="weld = -1.0: must be finite and not negative"):
        sprung.System.from_meshio(mesh, masses=1.0, weld=-1)
    with pytest.raises(ValueError, match="the mesh: has no points"):
        sprung.System.from_meshio(meshio.Mesh(np.zeros((0, 3)), []), masses=1.0)

    def leaves(path):
        raise SystemExit(1)

    monkeypatch.setattr(meshio, "read", leaves)
    with pytest.raises(ValueError, match="broken.vtk: meshio cannot read it"):
        sprung.System.from_meshio(tmp_path / "broken.vtk", masses=1.0)


def test_notes_on_the_mesh_of_a_scene_are_warnings(tmp_path):
    (tmp_path / "apart.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nl 1 2\n")
    (tmp_path / "apart.toml").write_text('mesh.file = "apart.obj"\nparticles.masses = 1.0\nsprings.stiffness = 1.0\n')
    with pytest.warns(UserWarning, match="particle 2 is in no edge") as found:
        sprung.System.load(tmp_path / "apart.toml")
    assert [one.filename for one in found] == [__file__]


def test_numbers_beyond_an_index_are_refused():
    with pytest.raises(ValueError, match="size = 10+: must be at most"):
        sprung.System.ready("cloth", 10**30)
    with pytest.raises(ValueError, match="n = 10+: must be at most"):
        sprung.modes(sprung.System.ready("string"), 10**30)


def test_other_springs_in_the_same_system():
    system = tangle().with_forces(lambda positions, velocities, time: -0.1 * velocities)
    other = system.with_springs(stiffness=2 * system.stiffness, damping=0.0)
    np.testing.assert_array_equal(other.stiffness, 2 * system.stiffness)
    np.testing.assert_array_equal(other.rest_lengths, system.rest_lengths)
    assert not other.damping.any() and system.damping.any()
    np.testing.assert_array_equal(other.dofs, system.dofs)
    state = system.initial_state()
    np.testing.assert_allclose(other.force(state, "elastic"), 2 * system.force(state, "elastic"), rtol=1e-12)
    np.testing.assert_array_equal(other.force(state, "external"), system.force(state, "external"))
    with pytest.raises(ValueError, match=r"stiffness = -1\.0: must be finite and positive"):
        system.with_springs(stiffness=-1.0)
    for name in ("stiffness", "rest_lengths", "damping"):
        wrong = np.ones(len(system.pairs))
        wrong[3] = np.nan
        with pytest.raises(ValueError, match=rf"{name}\[3\] = NaN"):
            system.with_springs(**{name: wrong})
        with pytest.raises(ValueError, match=rf"{name} = an array of shape \(2,\)"):
            system.with_springs(**{name: [1.0, 2.0]})


PULLED = """
gravity = { times = [0, 1], values = [[0, -9.81], [0, 0]] }
[particles]
positions = [[0, 0], [1, 0], [2, 0]]
masses = [1, 2, 3]
[springs]
pairs = [[0, 1], [1, 2]]
stiffness = [10, 20]
rest_lengths = [1, 2]
tension_only = [false, true]
[[springs.actuation]]
springs = [0]
path = { times = [0, 0.5], factors = [1, 1.5] }
[[forces]]
particles = [2]
value = [3, -1]
[drag]
coefficient = [0, 0.5, 1]
[[constraints]]
particles = [0]
"""


def pulled(**changed: object) -> sprung.System:
    given = dict(
        positions=[[0, 0], [1, 0], [2, 0]],
        pairs=[[0, 1], [1, 2]],
        masses=[1, 2, 3],
        stiffness=[10, 20],
        rest_lengths=[1, 2],
        tension_only=[False, True],
        actuation=[{"springs": [0], "path": {"times": [0, 0.5], "factors": [1, 1.5]}}],
        gravity={"times": [0, 1], "values": [[0, -9.81], [0, 0]]},
        loads=[[0, 0], [0, 0], [3, -1]],
        drag=[0, 0.5, 1],
        constraints=[sprung.Constraint(0)],
    )
    return sprung.System(**{**given, **changed})


def test_loads_and_springs_that_are_special_are_those_of_scene_files():
    system, scene = pulled(), sprung.System.parse(PULLED)
    ends = [sprung.Stepper(one, method="rodas4").run(0.8, rtol=1e-4).state for one in (system, scene)]
    np.testing.assert_array_equal(ends[0].positions, ends[1].positions)
    plain = sprung.Stepper(pulled(actuation=(), tension_only=False, drag=0.0, loads=None, gravity=None), method="rodas4")
    assert np.abs(plain.run(0.8, rtol=1e-4).state.positions - ends[0].positions).max() > 0.1
    for name in ("loads", "drag", "tension_only", "gravity"):
        np.testing.assert_array_equal(getattr(system, name), getattr(scene, name))
    # A pair is a path as well, and one value counts for all.
    other = pulled(gravity=([0, 1], [[0, -9.81], [0, 0]]), drag=0.5, tension_only=True)
    np.testing.assert_array_equal(other.gravity, [0, -9.81])
    assert list(other.drag) == [0.5] * 3 and all(other.tension_only)
    same(pickle.loads(pickle.dumps(system)), system)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(system)).loads, system.loads)


@pytest.mark.parametrize(
    "changed, message",
    [
        (dict(loads=[[0, 1]]), "loads = an array of shape (1, 2): must have the shape (3, 2)"),
        (dict(loads=[[0, 1], [0, 2], [0, np.nan]]), "loads[2] = [0.0, NaN, 0.0]: must be finite"),
        (dict(drag=[0, -1, 0]), "drag[1] = -1: must be finite and not negative"),
        (dict(drag=-1), "drag = -1.0: must be finite and not negative"),
        (dict(drag=[1, 2]), "drag = an array of shape (2,): must be one number, or one for each of the 3 particles"),
        (dict(tension_only=[True]), "tension_only = [True]: must be True or False"),
        (dict(tension_only=[1, 0]), "tension_only = [1, 0]: must be True or False"),
        (dict(gravity={"times": [0], "values": [[0, 1], [0, 2]]}), "gravity.values = a list of 2: must have one entry"),
        (dict(gravity={"times": [0], "value": [[0, 1]]}), "gravity = ['times', 'value']: must have the keys times and values"),
        (dict(actuation=[{"springs": [0]}]), "actuation[0] = {'springs': [0]}: must be a mapping with the keys springs and path"),
        (dict(actuation=[{"springs": [2], "path": ([0], [1])}]), "actuation[0].springs[0] = 2: names a spring that does not exist"),
        (dict(actuation=[{"springs": [0], "path": ([0, 1], [1, -1])}]), "actuation[0].path.factors[1] = -1: must be finite and positive"),
    ],
)
def test_unusable_loads_and_springs_are_named(changed, message):
    with pytest.raises(ValueError) as error:
        pulled(**changed)
    assert str(error.value).startswith(message)
