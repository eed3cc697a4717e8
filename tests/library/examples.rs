//! Every example that shows how to hand something of one's own to the methods runs, and comes to what it claims.

#[path = "../../examples/external_force.rs"]
mod external_force;
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

run!(external_force, own_blocks, own_preconditioner, own_solver, own_spring_law);
