//! Finds PETSc by pkg-config, links it, and generates the few declarations that `src/petsc.rs` uses.

use std::env;
use std::path::PathBuf;

/// Everything that `src/petsc.rs` calls.
const FUNCTIONS: &[&str] = &[
    "PetscInitialize",
    "PetscFinalize",
    "PetscErrorMessage",
    "PetscPushErrorHandler",
    "PetscOptionsLeft",
    "PetscMallocA",
    "VecCreateMPI",
    "VecDestroy",
    "VecSetBlockSize",
    "VecGetArray",
    "VecRestoreArray",
    "MatCreate",
    "MatDestroy",
    "MatSetSizes",
    "MatSetBlockSize",
    "MatSetType",
    "MatXAIJSetPreallocation",
    "MatSetOption",
    "MatSetValuesBlocked",
    "MatAssemblyBegin",
    "MatAssemblyEnd",
    "MatGetRow",
    "MatRestoreRow",
    "MatGetInertia",
    "MatSetNearNullSpace",
    "MatNullSpaceCreateRigidBody",
    "MatNullSpaceDestroy",
    "MatCreateMPIAdj",
    "MatPartitioningCreate",
    "MatPartitioningSetAdjacency",
    "MatPartitioningSetType",
    "MatPartitioningSetNParts",
    "MatPartitioningSetFromOptions",
    "MatPartitioningApply",
    "MatPartitioningDestroy",
    "ISGetIndices",
    "ISRestoreIndices",
    "ISDestroy",
    "KSPCreate",
    "KSPDestroy",
    "KSPSetOptionsPrefix",
    "KSPSetType",
    "KSPSetNormType",
    "KSPSetTolerances",
    "KSPSetOperators",
    "KSPSetFromOptions",
    "KSPSetUp",
    "KSPSetUpOnBlocks",
    "KSPSolve",
    "KSPGetIterationNumber",
    "KSPGetConvergedReason",
    "KSPGetPC",
    "PCFactorGetMatrix",
    "PCGetFailedReason",
];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=PKG_CONFIG_PATH");
    // For Open MPI to find the program's own, see `src/waiting.rs`.
    println!("cargo:rustc-link-arg-bins=-Wl,--export-dynamic-symbol=sched_yield");
    let found = pkg_config::Config::new()
        .atleast_version("3.18")
        .probe("PETSc")
        .or_else(|_| pkg_config::probe_library("petsc"));
    // PETSc's own entry does not name MPI's headers.
    let mpi = pkg_config::Config::new()
        .cargo_metadata(false)
        .probe("mpi-c")
        .or_else(|_| pkg_config::Config::new().cargo_metadata(false).probe("ompi-c"));
    let (Ok(petsc), Ok(mpi)) = (found, mpi) else {
        panic!("pkg-config knows no PETSc or no MPI: see the page about several machines in docs/guide");
    };
    let includes = petsc.include_paths.iter().chain(&mpi.include_paths);
    let mut builder = bindgen::Builder::default()
        .header_contents("petsc.h", "#include <petscksp.h>\n")
        .clang_args(includes.map(|path| format!("-I{}", path.display())))
        .allowlist_var("PETSC_COMM_WORLD|MPI_COMM_NULL")
        .default_enum_style(bindgen::EnumVariation::ModuleConsts)
        .layout_tests(false)
        .generate_comments(false);
    for function in FUNCTIONS {
        builder = builder.allowlist_function(function);
    }
    let target = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it")).join("petsc.rs");
    builder.generate().expect("clang reads PETSc's headers").write_to_file(target).expect("the folder is cargo's own");
}
