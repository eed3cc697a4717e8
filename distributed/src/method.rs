//! Names of methods, stiffness options and linear solvers.

use crate::or_end;
use crate::petsc::Petsc;
use crate::ranks;
use crate::solver::{Choice, Preconditioner};
use clap::builder::PossibleValuesParser;
use sprung::integrate::{ImplicitOptions, Method, StiffnessPolicy};
use sprung::linear::{SolverOptions, Tolerance};

/// Which method, stiffness and linear solver.
#[derive(Debug, clap::Args)]
pub struct MethodArguments {
    /// Time stepping method
    #[arg(long, default_value = "linear-backward-euler")]
    #[arg(value_parser = PossibleValuesParser::new(["linear-backward-euler", "bdf2", "verlet"]))]
    pub method: String,

    /// Which part of every spring's stiffness enters the matrix A; forces are never changed
    #[arg(long, default_value = "on-demand")]
    #[arg(value_parser = PossibleValuesParser::new(StiffnessPolicy::ALL.map(StiffnessPolicy::name)))]
    pub stiffness: String,

    /// Linear solver: conjugate gradients, or a factorization by MUMPS, which knows whether A is definite
    #[arg(long, default_value = "cg", value_parser = PossibleValuesParser::new(["cg", "mumps"]))]
    pub solver: String,

    /// Preconditioner of conjugate gradients
    #[arg(long, value_name = "KIND", value_enum, default_value_t = Preconditioner::Gamg)]
    pub preconditioner: Preconditioner,

    /// Conjugate gradients stop at ‖b − A·δx‖ ≤ R·‖b‖
    #[arg(long, value_name = "R", value_parser = positive, default_value = "1e-10")]
    pub tolerance: f64,

    /// Options of PETSc, which win over those that the preconditioner stands for: "-log_view", "-pc_type jacobi", …
    #[arg(long, value_name = "OPTIONS", default_value = "", allow_hyphen_values = true)]
    pub petsc: String,
}

impl MethodArguments {
    /// The solver asked for.
    pub fn choice(&self) -> Choice {
        if self.solver == "mumps" { Choice::Mumps } else { Choice::Cg(self.preconditioner) }
    }

    /// PETSc, started with all options.
    pub fn start(&self) -> Petsc {
        let choice = self.choice();
        let of_several = if ranks::ranks() > 1 { choice.options_of_several() } else { "" };
        or_end(Petsc::start(&[choice.options(), of_several, Choice::SPARE, &self.petsc].join(" ")))
    }

    /// The stiffness policy asked for.
    pub fn policy(&self) -> StiffnessPolicy {
        let named = StiffnessPolicy::ALL.into_iter().find(|policy| policy.name() == self.stiffness);
        named.unwrap_or(StiffnessPolicy::OnDemand)
    }

    /// The options of implicit methods.
    pub fn options(&self) -> ImplicitOptions {
        let linear = SolverOptions { tolerance: Tolerance::Fixed(self.tolerance), ..SolverOptions::default() };
        ImplicitOptions { stiffness: self.policy(), linear }
    }

    /// The method asked for.
    pub fn method(&self) -> Method {
        match self.method.as_str() {
            "bdf2" => Method::Bdf2,
            "verlet" => Method::Verlet,
            _ => Method::LinearBackwardEuler,
        }
    }
}

/// A finite number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("must be finite and positive".to_owned()) }
}
