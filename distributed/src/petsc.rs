//! Bindings to PETSc: every handle is owned by a value that destroys it, and every error is a `Result`.
//!
//! All `unsafe` code is in this file, in that of `partition`, and around one function in `waiting`. The calls are sound because handles come from PETSc, are
//! used only while the [`Petsc`] that they borrow is alive, and are destroyed once, by their owner, and arrays have the length that PETSc receives. Other
//! reasons are given at the call.
//!
//! Calls are collective: all ranks make the same ones in the same order, and drop in the same order. An `Err` on one rank alone
//! leaves the others waiting, so `main` ends with `MPI_Abort` on every one that not all ranks have.

#![allow(unsafe_code)]

#[allow(warnings, missing_docs, clippy::all)]
mod ffi {
    include!(concat!(env!("OUT_DIR"), "/petsc.rs"));
}

use ffi::*;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::vec::Vec;
use std::{fmt, ptr, slice};

/// PETSc's integer: 32 or 64 bits, as it was built.
pub type Index = PetscInt;

/// The most rows that can be numbered.
pub const MOST_ROWS: u64 = Index::MAX as u64;

/// What PETSc says of a call that failed.
#[derive(Debug)]
pub struct Error {
    code: i64,
    call: &'static str,
    message: String,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: PETSc error {}: {}", self.call, self.code, self.message)
    }
}

impl std::error::Error for Error {}

/// Of calls of PETSc.
pub type Result<T> = std::result::Result<T, Error>;

thread_local! {
    /// What the first of the nested calls that fail says.
    static MESSAGE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Keeps the first message of an error, in place of printing a trace of all calls.
unsafe extern "C" fn remember(
    _: MPI_Comm,
    _: c_int,
    function: *const c_char,
    _: *const c_char,
    code: PetscErrorCode,
    kind: PetscErrorType::Type,
    message: *const c_char,
    _: *mut c_void,
) -> PetscErrorCode {
    if kind == PetscErrorType::PETSC_ERROR_INITIAL {
        let text = format!("{} in {}", text(message).trim(), text(function));
        MESSAGE.with(|kept| *kept.borrow_mut() = text);
    }
    code
}

/// A text of PETSc's.
fn text(from: *const c_char) -> String {
    if from.is_null() {
        return String::new();
    }
    // SAFETY: PETSc hands out C strings that live at least until the call that they are about has returned.
    unsafe { CStr::from_ptr(from) }.to_string_lossy().into_owned()
}

fn check(call: &'static str, code: PetscErrorCode) -> Result<()> {
    if code == 0 {
        return Ok(());
    }
    let mut message = MESSAGE.with(|kept| std::mem::take(&mut *kept.borrow_mut()));
    if message.is_empty() {
        let mut known = ptr::null();
        // SAFETY: fills in a pointer to a text that is part of the library.
        unsafe { PetscErrorMessage(code, &mut known, ptr::null_mut()) };
        message = text(known);
    }
    Err(Error { code: i64::from(code), call, message })
}

/// A call by the rules of the module.
macro_rules! call {
    ($function:ident($($argument:expr),* $(,)?)) => {
        // SAFETY: see the module.
        check(stringify!($function), unsafe { $function($($argument),*) })
    };
}

// Below the macro, which it uses.
mod partition;

pub use partition::partition;

/// A text without zeros.
fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

fn index(number: usize) -> Result<Index> {
    Index::try_from(number).map_err(|_| Error {
        code: 56,
        call: "PetscInt",
        message: format!("{number} does not fit its {} bits: use a PETSc with 64-bit indices", Index::BITS),
    })
}

/// Keeps PT-Scotch from starting threads, with which it waits for ever at times where ranks share cores (7.0.3). To be called
/// first of all; what the user sets stays.
pub fn partition_without_threads() {
    let name = "SCOTCH_PTHREAD_NUMBER";
    if std::env::var_os(name).is_none() {
        // SAFETY: `main` calls this before there is a thread that could read the environment.
        unsafe { std::env::set_var(name, "1") };
    }
}

/// PETSc, from its start to its end. MPI must be initialised before and finalised after.
pub struct Petsc(());

impl Petsc {
    /// With options as on PETSc's command line, later ones winning.
    pub fn start(options: &str) -> Result<Self> {
        let words: Vec<CString> = ["sprung-mpi"].into_iter().chain(options.split_whitespace()).map(c_text).collect();
        let mut pointers: Vec<*mut c_char> = words.iter().map(|word| word.as_ptr().cast_mut()).collect();
        let mut count = pointers.len() as c_int;
        pointers.push(ptr::null_mut());
        // PETSc keeps the arguments as long as it runs.
        std::mem::forget(words);
        let mut arguments = pointers.leak().as_mut_ptr();
        call!(PetscInitialize(&mut count, &mut arguments, ptr::null(), ptr::null()))?;
        call!(PetscPushErrorHandler(Some(remember), ptr::null_mut()))?;
        Ok(Self(()))
    }

    /// Prints options that nothing has read: misspelt ones.
    pub fn report_unused_options(&self) -> Result<()> {
        call!(PetscOptionsLeft(ptr::null_mut()))
    }
}

fn world() -> MPI_Comm {
    // SAFETY: a variable that PETSc sets in its start, before there is any value of this module, and never changes.
    unsafe { PETSC_COMM_WORLD }
}

impl Drop for Petsc {
    fn drop(&mut self) {
        // SAFETY: every handle borrows this value, so none is left.
        unsafe { PetscFinalize() };
    }
}

macro_rules! handle {
    ($(#[$about:meta])* $name:ident, $raw:ty, $destroy:ident) => {
        $(#[$about])*
        pub struct $name<'p>($raw, PhantomData<&'p Petsc>);

        impl Drop for $name<'_> {
            fn drop(&mut self) {
                // SAFETY: the handle is owned, and this is the only place that destroys it.
                unsafe { $destroy(&mut self.0) };
            }
        }

        // SAFETY: PETSc keeps nothing by thread, and no handle is used by two: none is shared, for it is not `Sync`.
        unsafe impl Send for $name<'_> {}
    };
}

handle!(
    /// A vector, of which every rank has consecutive entries.
    Vector, ffi::Vec, VecDestroy
);
handle!(
    /// A matrix, of which every rank has consecutive rows.
    Matrix, Mat, MatDestroy
);
handle!(
    /// Conjugate gradients with a preconditioner, or a factorization.
    Solver, KSP, KSPDestroy
);

impl<'p> Vector<'p> {
    /// Zeros, `blocks` of `size` entries on this rank.
    pub fn new(_: &'p Petsc, blocks: usize, size: usize) -> Result<Self> {
        let mut raw = ptr::null_mut();
        call!(VecCreateMPI(world(), index(size * blocks)?, PETSC_DECIDE, &mut raw))?;
        let vector = Self(raw, PhantomData);
        call!(VecSetBlockSize(raw, index(size)?))?;
        Ok(vector)
    }

    /// Works on this rank's entries, of which there are `count`.
    pub fn with<R>(&self, count: usize, work: impl FnOnce(&mut [f64]) -> R) -> Result<R> {
        let mut values = ptr::null_mut();
        call!(VecGetArray(self.0, &mut values))?;
        // SAFETY: PETSc lends its array, of as many entries as the vector was made with, until it is restored. Where there are
        // none it may be null, which a slice must not be.
        let result = work(if count == 0 { &mut [] } else { unsafe { slice::from_raw_parts_mut(values, count) } });
        call!(VecRestoreArray(self.0, &mut values))?;
        Ok(result)
    }
}

const PETSC_DECIDE: Index = -1;

/// How many blocks a row has: with columns of this rank and of others, and the same on and above the diagonal.
#[derive(Debug, Default)]
pub struct Counts {
    pub own: Vec<Index>,
    pub other: Vec<Index>,
    pub own_upper: Vec<Index>,
    pub other_upper: Vec<Index>,
}

impl<'p> Matrix<'p> {
    /// With rows of blocks of `size` × `size` entries and so many blocks in each row, of the type `aij` or `sbaij`.
    pub fn new(_: &'p Petsc, kind: &str, size: usize, counts: &Counts) -> Result<Self> {
        let mut raw = ptr::null_mut();
        let kind = c_text(kind);
        call!(MatCreate(world(), &mut raw))?;
        let matrix = Self(raw, PhantomData);
        let rows = index(size * counts.own.len())?;
        call!(MatSetSizes(raw, rows, rows, PETSC_DECIDE, PETSC_DECIDE))?;
        call!(MatSetBlockSize(raw, index(size)?))?;
        call!(MatSetType(raw, kind.as_ptr()))?;
        let Counts { own, other, own_upper, other_upper } = counts;
        // PETSc would count past its largest number without a word.
        for counts in [own, other] {
            index(size * size * counts.iter().map(|&count| count as usize).sum::<usize>())?;
        }
        let counts = [own, other, own_upper, other_upper].map(|counts| counts.as_ptr());
        call!(MatXAIJSetPreallocation(raw, index(size)?, counts[0], counts[1], counts[2], counts[3]))?;
        // Every rank computes its own rows whole: nothing to send, nothing to look for.
        matrix.set(MatOption::MAT_NO_OFF_PROC_ENTRIES)?;
        matrix.set(MatOption::MAT_NEW_NONZERO_ALLOCATION_ERR)?;
        matrix.set(MatOption::MAT_SYMMETRIC)?;
        matrix.set(MatOption::MAT_SYMMETRY_ETERNAL)?;
        if kind.to_bytes().ends_with(b"sbaij") {
            matrix.set(MatOption::MAT_IGNORE_LOWER_TRIANGULAR)?;
            matrix.set(MatOption::MAT_GETROW_UPPERTRIANGULAR)?;
        }
        Ok(matrix)
    }

    /// Says that the matrix is as good as positive definite: what is not is found out by conjugate gradients.
    pub fn trust_definite(&self) -> Result<()> {
        self.set(MatOption::MAT_SPD)?;
        self.set(MatOption::MAT_SPD_ETERNAL)
    }

    fn set(&self, option: MatOption::Type) -> Result<()> {
        call!(MatSetOption(self.0, option, PetscBool::PETSC_TRUE))
    }

    /// Overwrites a row of blocks; `values` holds its rows one after the other.
    pub fn set_row(&self, row: Index, columns: &[Index], values: &[f64], size: usize) -> Result<()> {
        assert_eq!(values.len(), size * size * columns.len());
        let count = index(columns.len())?;
        call!(MatSetValuesBlocked(self.0, 1, &row, count, columns.as_ptr(), values.as_ptr(), InsertMode::INSERT_VALUES))
    }

    /// Ends the overwriting.
    pub fn assemble(&self) -> Result<()> {
        call!(MatAssemblyBegin(self.0, MatAssemblyType::MAT_FINAL_ASSEMBLY))?;
        call!(MatAssemblyEnd(self.0, MatAssemblyType::MAT_FINAL_ASSEMBLY))
    }

    /// Columns and values of one of this rank's rows; of a type that keeps one triangle, those on and above the diagonal.
    pub fn row(&self, row: Index) -> Result<Vec<(Index, f64)>> {
        let (mut count, mut columns, mut values) = (0, ptr::null(), ptr::null());
        call!(MatGetRow(self.0, row, &mut count, &mut columns, &mut values))?;
        // SAFETY: both arrays have `count` entries until the row is restored.
        let entries = (0..count as usize).map(|at| unsafe { (*columns.add(at), *values.add(at)) }).collect();
        call!(MatRestoreRow(self.0, row, &mut count, &mut columns, &mut values))?;
        Ok(entries)
    }

    /// Rigid motions of particles at these positions, as what multigrid must keep.
    pub fn set_rigid_modes(&self, positions: &Vector) -> Result<()> {
        let mut space = ptr::null_mut();
        call!(MatNullSpaceCreateRigidBody(positions.0, &mut space))?;
        let set = call!(MatSetNearNullSpace(self.0, space));
        call!(MatNullSpaceDestroy(&mut space))?;
        set
    }
}

/// How a solve ended.
#[derive(Debug, Clone, Copy)]
pub struct Solved {
    pub iterations: u64,
    pub end: End,
}

/// What ended a solve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    Converged,
    NegativeCurvature,
    /// The preconditioner is not positive definite, or could not be set up.
    Preconditioner,
    IterationLimit,
    NonFinite,
    Diverged,
}

impl End {
    fn of(reason: KSPConvergedReason::Type) -> Self {
        match reason {
            KSPConvergedReason::KSP_DIVERGED_INDEFINITE_MAT => Self::NegativeCurvature,
            KSPConvergedReason::KSP_DIVERGED_INDEFINITE_PC | KSPConvergedReason::KSP_DIVERGED_PC_FAILED => {
                Self::Preconditioner
            }
            KSPConvergedReason::KSP_DIVERGED_ITS => Self::IterationLimit,
            KSPConvergedReason::KSP_DIVERGED_NANORINF => Self::NonFinite,
            reason if reason > 0 => Self::Converged,
            _ => Self::Diverged,
        }
    }
}

impl<'p> Solver<'p> {
    /// Of a type (`cg`, or `preonly` for a factorization), with options that begin with a prefix.
    pub fn new(_: &'p Petsc, kind: &str, prefix: &str) -> Result<Self> {
        let mut raw = ptr::null_mut();
        call!(KSPCreate(world(), &mut raw))?;
        let solver = Self(raw, PhantomData);
        let (kind_text, prefix) = (c_text(kind), c_text(prefix));
        call!(KSPSetOptionsPrefix(raw, prefix.as_ptr()))?;
        call!(KSPSetType(raw, kind_text.as_ptr()))?;
        if kind == "cg" {
            call!(KSPSetNormType(raw, KSPNormType::KSP_NORM_UNPRECONDITIONED))?;
        }
        call!(KSPSetFromOptions(raw))?;
        Ok(solver)
    }

    /// Iterations end at ‖b − A x‖ ≤ tolerance·‖b‖.
    pub fn set_tolerance(&self, tolerance: f64, iterations: usize) -> Result<()> {
        call!(KSPSetTolerances(self.0, tolerance, 0.0, 1e10, index(iterations)?))
    }

    /// Sets the preconditioner up for a matrix, or factors it.
    pub fn prepare(&self, a: &Matrix) -> Result<()> {
        call!(KSPSetOperators(self.0, a.0, a.0))?;
        call!(KSPSetUp(self.0))?;
        call!(KSPSetUpOnBlocks(self.0))
    }

    /// Whether the preconditioner could not be set up on this rank.
    pub fn has_failed(&self) -> Result<bool> {
        let (mut preconditioner, mut reason) = (ptr::null_mut(), 0);
        call!(KSPGetPC(self.0, &mut preconditioner))?;
        call!(PCGetFailedReason(preconditioner, &mut reason))?;
        Ok(reason != 0)
    }

    /// Of a factorization: the number of negative eigenvalues, and of those that are zero.
    pub fn inertia(&self) -> Result<[usize; 2]> {
        let (mut preconditioner, mut factor) = (ptr::null_mut(), ptr::null_mut());
        let (mut negative, mut zero, mut positive) = (0, 0, 0);
        call!(KSPGetPC(self.0, &mut preconditioner))?;
        call!(PCFactorGetMatrix(preconditioner, &mut factor))?;
        call!(MatGetInertia(factor, &mut negative, &mut zero, &mut positive))?;
        Ok([negative, zero].map(|count| count as usize))
    }

    /// Solves A x = b from x = 0.
    pub fn solve(&self, b: &Vector, x: &Vector) -> Result<Solved> {
        let (mut iterations, mut reason) = (0, 0);
        call!(KSPSolve(self.0, b.0, x.0))?;
        call!(KSPGetIterationNumber(self.0, &mut iterations))?;
        call!(KSPGetConvergedReason(self.0, &mut reason))?;
        Ok(Solved { iterations: iterations as u64, end: End::of(reason) })
    }
}
