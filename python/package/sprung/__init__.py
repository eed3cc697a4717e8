"""Implicit mass-spring systems with their matrices in numpy and scipy.

`sprung` assembles the system matrix ``A = M/dt**2 - G/dt - K`` of a mass-spring system explicitly and steps in time. It
verifies Jacobians, the definiteness of A and the springs that affect it, step limits, and the error of a run.

>>> import sprung
>>> system = sprung.System(
...     positions=[[0, 0, 0], [1.1, 0, 0]], pairs=[[0, 1]], masses=1.0, stiffness=100.0, rest_lengths=1.0,
...     gravity=[0, -9.81, 0], constraints=[sprung.Constraint(0)])
>>> matrices = system.matrices(dt=0.01)
>>> matrices.A.shape
(3, 3)
>>> result = sprung.Stepper(system).run(1.0)  # chooses method and steps
>>> result.status, result.error < 0.01
('completed', True)

SI units everywhere; particles and springs are numbered from 0. ``K = df_elastic/dx`` and ``G = df_damping/dv`` are
negative (semidefinite) where the system is stable.
"""

from ._checks import AdjointCheck, GradientCheck, HessianCheck, check_adjoint, check_gradient, check_hessian
from ._constraint import Constraint
from ._errors import Breakdown, DoubtWarning
from ._fit import Fit, fit
from ._functions import ExternalForce
from ._gradient import DifferentiableRun, Gradient
from ._inspect import Inspection, inspect
from ._jacobian import Entry, JacobianCheck, check_jacobian
from ._matrices import Factor, Matrices, NotPositiveDefinite
from ._native import __version__
from ._result import Result
from ._state import Energy, State
from ._statics import Equilibrium, Mechanisms, Modes, equilibrium, mechanisms, modes
from ._stepper import Stepper
from ._system import System
from ._verify import Verification, verify

__all__ = [
    "AdjointCheck",
    "Breakdown",
    "Constraint",
    "DifferentiableRun",
    "DoubtWarning",
    "Energy",
    "Entry",
    "Equilibrium",
    "ExternalForce",
    "Factor",
    "Fit",
    "Gradient",
    "GradientCheck",
    "HessianCheck",
    "Inspection",
    "JacobianCheck",
    "Matrices",
    "Mechanisms",
    "Modes",
    "NotPositiveDefinite",
    "Result",
    "State",
    "Stepper",
    "System",
    "Verification",
    "__version__",
    "check_adjoint",
    "check_gradient",
    "check_hessian",
    "check_jacobian",
    "equilibrium",
    "fit",
    "inspect",
    "mechanisms",
    "modes",
    "verify",
]
