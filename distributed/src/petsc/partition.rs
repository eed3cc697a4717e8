//! Cutting a graph into parts, by a library that PETSc knows.

use super::ffi::*;
use super::{Index, Petsc, Result, c_text, check, index, world};
use std::ffi::c_void;
use std::ptr;
use std::vec::Vec;

/// Which part each of this rank's vertices goes to, from the rank's rows of a symmetric graph without loops.
pub fn partition(
    _: &Petsc,
    kind: &str,
    total: usize,
    offsets: &[usize],
    neighbours: &[u64],
    parts: usize,
) -> Result<Vec<usize>> {
    let vertices = offsets.len() - 1;
    let copy = |from: &[Index]| -> Result<*mut Index> {
        let mut to: *mut c_void = ptr::null_mut();
        let (bytes, here) = (size_of_val(from).max(size_of::<Index>()), c_text("partition"));
        let place = (&raw mut to).cast();
        // The matrix frees its arrays with PetscFree: they must be PETSc's own.
        call!(PetscMallocA(1, PetscBool::PETSC_FALSE, 0, here.as_ptr(), here.as_ptr(), bytes, place))?;
        // SAFETY: there is room for as many bytes, and it is nobody else's.
        unsafe { ptr::copy_nonoverlapping(from.as_ptr(), to.cast(), from.len()) };
        Ok(to.cast())
    };
    let offsets: Vec<Index> = offsets.iter().map(|&at| index(at)).collect::<Result<_>>()?;
    let neighbours: Vec<Index> = neighbours.iter().map(|&at| index(at as usize)).collect::<Result<_>>()?;
    let kind = c_text(kind);
    let (mut graph, mut partitioning, mut set) = (ptr::null_mut(), ptr::null_mut(), ptr::null_mut());
    let (starts, ends) = (copy(&offsets)?, copy(&neighbours)?);
    call!(MatCreateMPIAdj(world(), index(vertices)?, index(total)?, starts, ends, ptr::null_mut(), &mut graph))?;
    call!(MatPartitioningCreate(world(), &mut partitioning))?;
    call!(MatPartitioningSetAdjacency(partitioning, graph))?;
    call!(MatPartitioningSetType(partitioning, kind.as_ptr()))?;
    call!(MatPartitioningSetNParts(partitioning, index(parts)?))?;
    call!(MatPartitioningSetFromOptions(partitioning))?;
    call!(MatPartitioningApply(partitioning, &mut set))?;
    let mut values = ptr::null();
    call!(ISGetIndices(set, &mut values))?;
    // SAFETY: the set has one entry for each of this rank's vertices until it is restored.
    let part = (0..vertices).map(|v| unsafe { *values.add(v) } as usize).collect();
    call!(ISRestoreIndices(set, &mut values))?;
    call!(ISDestroy(&mut set))?;
    call!(MatPartitioningDestroy(&mut partitioning))?;
    call!(MatDestroy(&mut graph))?;
    Ok(part)
}
