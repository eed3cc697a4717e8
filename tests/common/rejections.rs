//! Every rejection of the scene format: a valid scene, edits that each put one wrong thing into it, and what is then said.

/// A valid scene.
pub const VALID: &str = include_str!("valid.toml");

/// [`VALID`] with one text replaced by another.
pub fn edited(from: &str, to: &str) -> String {
    assert_eq!(VALID.matches(from).count(), 1, "{from:?} must be in the scene exactly once");
    VALID.replace(from, to)
}

/// Hands the table to a macro: `name: edit from, edit to => message without the file`.
#[macro_export]
macro_rules! rejections {
    ($use:ident) => {
        $use! {
            mass_zero: "[1.0, 2.0, 3.0]", "[1.0, 2.0, 0.0]" => "particles.masses[2] = 0: must be finite and positive";
            mass_negative: "[1.0, 2.0, 3.0]", "[1.0, -2.5, 3.0]" => "particles.masses[1] = -2.5: must be finite and positive";
            mass_nan: "[1.0, 2.0, 3.0]", "[nan, 2.0, 3.0]" => "particles.masses[0] = NaN: must be finite and positive";
            mass_infinite: "[1.0, 2.0, 3.0]", "[1.0, inf, 3.0]" => "particles.masses[1] = inf: must be finite and positive";
            mass_for_all_zero: "[1.0, 2.0, 3.0]", "0" => "particles.masses = 0: must be positive";
            mass_for_all_nan: "[1.0, 2.0, 3.0]", "nan" => "particles.masses = NaN: must be finite";
            mass_for_all_of_too_much_energy: "[1.0, 2.0, 3.0]", "1e308" => "particles.masses = 1e308: makes an energy beyond the largest number";
            masses_too_few: "[1.0, 2.0, 3.0]", "[1.0, 2.0]" => "particles.masses = a list of 2: must have one entry for each of the 3 particles";
            masses_absent: "masses = [1.0, 2.0, 3.0]", "" => "particles.masses: must be given, one number for all or one for each of the 3 particles";
            masses_text: "[1.0, 2.0, 3.0]", "\"heavy\"" => "particles.masses: is the text \"heavy\", must be a number or a list of numbers at line 8 column 10";

            stiffness_zero: "[100.0, 200.0]", "[100.0, 0]" => "springs.stiffness[1] = 0: must be finite and positive";
            stiffness_negative: "[100.0, 200.0]", "[-1e-3, 200.0]" => "springs.stiffness[0] = -0.001: must be finite and positive";
            stiffness_infinite: "[100.0, 200.0]", "[100.0, +inf]" => "springs.stiffness[1] = inf: must be finite and positive";
            stiffness_for_all_negative: "[100.0, 200.0]", "-1" => "springs.stiffness = -1: must be positive";
            stiffness_too_many: "[100.0, 200.0]", "[100.0, 200.0, 300.0]" => "springs.stiffness = a list of 3: must have one entry for each of the 2 springs";
            stiffness_absent: "stiffness = [100.0, 200.0]", "" => "springs.stiffness: must be given, one number for all or one for each of the 2 springs";

            rest_length_negative: "[1.0, 1.2]", "[1.0, -1.2]" => "springs.rest_lengths[1] = -1.2: must be finite and not negative";
            rest_length_nan: "[1.0, 1.2]", "[1.0, nan]" => "springs.rest_lengths[1] = NaN: must be finite and not negative";
            rest_length_for_all_infinite: "[1.0, 1.2]", "inf" => "springs.rest_lengths = inf: must be finite";
            rest_lengths_too_few: "[1.0, 1.2]", "[1.0]" => "springs.rest_lengths = a list of 1: must have one entry for each of the 2 springs";

            damping_negative: "[0.3, 0.0]", "[0.3, -0.1]" => "springs.damping[1] = -0.1: must be finite and not negative";
            damping_infinite: "[0.3, 0.0]", "[inf, 0.0]" => "springs.damping[0] = inf: must be finite and not negative";
            damping_for_all_negative: "[0.3, 0.0]", "-0.3" => "springs.damping = -0.3: must not be negative";
            damping_too_many: "[0.3, 0.0]", "[0.3, 0.0, 0.0]" => "springs.damping = a list of 3: must have one entry for each of the 2 springs";

            pair_out_of_range: "[[0, 1], [1, 2]]", "[[0, 1], [1, 3]]" => "springs.pairs[1] = [1, 3]: names a particle that does not exist (there are 3)";
            pair_of_too_large_a_number: "[[0, 1], [1, 2]]", "[[0, 1], [1, 4294967297]]" => "springs.pairs[1][1]: is 4294967297, must be a whole number below 2^32 at line 11 column 22";
            pair_negative: "[[0, 1], [1, 2]]", "[[0, -1], [1, 2]]" => "springs.pairs[0][1]: is -1, must be a whole number, not negative at line 11 column 14";
            pair_of_one_particle: "[[0, 1], [1, 2]]", "[[0, 1], [2, 2]]" => "springs.pairs[1] = [2, 2]: joins a particle to itself";
            pair_of_three: "[[0, 1], [1, 2]]", "[[0, 1], [0, 1, 2]]" => "springs.pairs[1]: has 3 entries, must be a pair of particle numbers at line 11 column 18";
            pair_of_one: "[[0, 1], [1, 2]]", "[[0], [1, 2]]" => "springs.pairs[0]: has 1 entry, must be a pair of particle numbers at line 11 column 10";
            spring_of_zero_length: "[1.1, 0, 0]", "[0, 0, 0]" => "springs.pairs[0] = [0, 1]: is a spring of zero current length";

            positions_ragged: "[1.1, 0, 0]", "[1.1, 0]" => "particles.positions[1] = [1.1, 0.0]: must have length 3, as the scene's other rows";
            position_empty: "[1.1, 0, 0]", "[]" => "particles.positions[1]: has 0 entries, must be a row of 1, 2 or 3 numbers at line 6 column 25";
            position_of_four: "[1.1, 0, 0]", "[1.1, 0, 0, 0]" => "particles.positions[1]: has 4 entries, must be a row of 1, 2 or 3 numbers at line 6 column 25";
            position_nan: "[1.1, 0, 0]", "[1.1, nan, 0]" => "particles.positions[1] = [1.1, NaN, 0.0]: must be finite";
            position_infinite: "[1.5, 0.9, 0.2]", "[1.5, 0.9, -inf]" => "particles.positions[2] = [1.5, 0.9, -inf]: must be finite";
            position_beyond_double: "[1.1, 0, 0]", "[1.1, 1e999, 0]" => "particles.positions[1][1]: floating-point number overflowed at line 6 column 31";
            velocities_ragged: "[0, 0.5, 0]", "[0.5]" => "particles.velocities[1] = [0.5]: must have length 3, as the scene's other rows";
            velocity_nan: "[0, 0.5, 0]", "[0, nan, 0]" => "particles.velocities[1] = [0.0, NaN, 0.0]: must be finite";
            velocities_too_few: "[[0, 0, 0], [0, 0.5, 0], [0, 0, 0]]", "[]" => "particles.velocities = a list of 0: must have one entry for each of the 3 particles";
            gravity_planar: "[0.0, -9.81, 0.0]", "[0.0, -9.81]" => "gravity = [0.0, -9.81]: must have length 3, as the scene's other rows";
            gravity_infinite: "[0.0, -9.81, 0.0]", "[0.0, -inf, 0.0]" => "gravity = [0.0, -inf, 0.0]: must be finite";

            constraint_of_no_particle: "particles = [1, 2]", "particles = [1, 3]" => "constraints[1].particles[1] = 3: names a particle that does not exist (there are 3)";
            constraint_without_particles: "particles = [1, 2]", "" => "constraints[1]: missing key particles at line 21 column 1";
            constraint_axis_unknown: "[\"x\", \"y\"]", "[\"x\", \"w\"]" => "constraints[0].axes[1]: is the text \"w\", must be \"x\", \"y\" or \"z\" at line 18 column 14";
            constraint_velocity_planar: "[0, 0, 0.5]", "[0, 0.5]" => "constraints[0].velocity = [0.0, 0.5]: must have length 3, as the scene's other rows";
            constraint_velocity_nan: "[0, 0, 0.5]", "[nan, 0, 0.5]" => "constraints[0].velocity = [NaN, 0.0, 0.5]: must be finite";
            constraint_of_two_motions: "particles = [1, 2]", "particles = [1, 2]\nvelocity = [1, 0, 0]" => "constraints[1] = velocity and path: give only one of the two";
            path_times_decreasing: "times = [0, 1]", "times = [0, -1]" => "constraints[1].path.times[1] = -1: times must increase";
            path_times_equal: "times = [0, 1]", "times = [1, 1]" => "constraints[1].path.times[1] = 1: times must increase";
            path_time_nan: "times = [0, 1]", "times = [0, nan]" => "constraints[1].path.times[1] = NaN: must be finite";
            path_time_infinite: "times = [0, 1]", "times = [0, inf]" => "constraints[1].path.times[1] = inf: must be finite";
            path_without_times: "times = [0, 1], offsets = [[0, 0, 0], [0, 0.2, 0]]", "times = [], offsets = []" => "constraints[1].path.times = []: must have at least one entry";
            path_offsets_too_few: "[[0, 0, 0], [0, 0.2, 0]]", "[[0, 0, 0]]" => "constraints[1].path.offsets = a list of 1: must have one entry for each of the 2 times";
            path_offsets_ragged: "[0, 0.2, 0]", "[0, 0.2]" => "constraints[1].path.offsets[1] = [0.0, 0.2]: must have length 3, as the scene's other rows";
            path_offset_nan: "[0, 0.2, 0]", "[0, nan, 0]" => "constraints[1].path.offsets[1] = [0.0, NaN, 0.0]: must be finite";

            unknown_key: "name =", "colour = 3\nname =" => "colour: unknown key colour, must be one of name, gravity, particles, springs, mesh, constraints, forces, drag, time at line 2 column 1";
            unknown_key_of_particles: "masses =", "mass =" => "particles.mass: unknown key mass, must be one of positions, velocities, masses at line 8 column 1; did you mean masses?";
            unknown_key_of_springs: "damping =", "friction =" => "springs.friction: unknown key friction, must be one of pairs, stiffness, rest_lengths, damping, tension_only, actuation at line 14 column 1";
            unknown_key_of_constraint: "particles = [1, 2]", "particles = [1, 2]\naxis = \"x\"" => "constraints[1].axis: unknown key axis, must be one of particles, axes, velocity, path at line 23 column 1; did you mean axes?";
            unknown_key_of_path: "times = [0, 1],", "times = [0, 1], loop = true," => "constraints[1].path.loop: unknown key loop, must be times or offsets at line 23 column 26";
            unknown_key_of_time: "duration =", "end =" => "time.end: unknown key end, must be dt or duration at line 27 column 1";
            unknown_key_of_mesh: "[time]", "[mesh]\nfile = \"a.obj\"\nunit = 1\n[time]" => "mesh.unit: unknown key unit, must be one of file, scale, weld at line 27 column 1";

            dt_zero: "dt = 0.01", "dt = 0" => "time.dt = 0: must be positive";
            dt_nan: "dt = 0.01", "dt = nan" => "time.dt = NaN: must be finite";
            dt_infinite: "dt = 0.01", "dt = inf" => "time.dt = inf: must be finite";
            duration_negative: "duration = 1.0", "duration = -1.0" => "time.duration = -1: must not be negative";
            duration_infinite: "duration = 1.0", "duration = inf" => "time.duration = inf: must be finite";

            mesh_beside_positions: "[time]", "[mesh]\nfile = \"a.obj\"\n[time]" => "particles.positions = a list of 3: must be absent: [mesh] fills it";

            name_empty: "\"valid\"", "\"\"" => "name: \"\" must not be empty at line 2 column 8";
            name_of_a_parent: "\"valid\"", "\"..\"" => "name: \"..\" must do as a folder's name: no path separators, no control characters, not \".\" or \"..\" at line 2 column 8";
            name_with_a_separator: "\"valid\"", "\"a/b\"" => "name: \"a/b\" must do as a folder's name: no path separators, no control characters, not \".\" or \"..\" at line 2 column 8";
            key_twice: "masses =", "masses = 1\nmasses =" => "given twice: masses at line 9 column 1";
            table_unclosed: "[time]", "[time" => "unclosed table, expected `]` at line 25 column 6";
        }
    };
}
