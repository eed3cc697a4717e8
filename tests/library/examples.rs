//! Every example that shows how to hand something of one's own to the methods, or to change a system, runs, and comes to what it claims.

#[path = "../../examples/change_in_mid_run.rs"]
mod change_in_mid_run;
#[path = "../../examples/external_force.rs"]
mod external_force;
#[path = "../../examples/identification.rs"]
mod identification;
#[path = "../../examples/own_blocks.rs"]
mod own_blocks;
#[path = "../../examples/own_preconditioner.rs"]
mod own_preconditioner;
#[path = "../../examples/own_solver.rs"]
mod own_solver;
#[path = "../../examples/own_spring_law.rs"]
mod own_spring_law;

macro_rules! run {
    ($($name:ident),*) => {
        $(
            #[test]
            fn $name() {
                self::$name::main().unwrap();
            }
        )*
    };
}

run!(change_in_mid_run, external_force, identification, own_blocks, own_preconditioner, own_solver, own_spring_law);

/// The page on changes in mid-run shows the lines of its example, as they are there.
#[test]
fn the_page_on_changes_in_mid_run_shows_its_example() {
    let (example, page) = (
        include_str!("../../examples/change_in_mid_run.rs"),
        include_str!("../../docs/guide/src/how-to/change-in-mid-run.md"),
    );
    let (_, shown) = page.split_once("```rust,ignore\n").unwrap();
    let (shown, _) = shown.split_once("```").unwrap();
    let (_, lines) = example.split_once("// ANCHOR: change\n").unwrap();
    let (lines, _) = lines.split_once("    // ANCHOR_END").unwrap();
    let lines: String = lines.lines().map(|line| format!("{}\n", line.strip_prefix("    ").unwrap_or(line))).collect();
    assert_eq!(shown, lines);
}
