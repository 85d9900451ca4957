//! Energies in which a coordinate moves no mass, whatever the configuration.

use lagrange::{Mechanics, Role};
use nalgebra::{DMatrix, SymmetricEigen};

use super::document::{Faults, Section};
use crate::naming::quoted;

/// M counts as singular where its least eigenvalue, with units taken out, is at most this.
const SINGULAR: f64 = 1e-13;
/// Sizes of the configurations that are tried, m and rad.
const SIZES: [f64; 6] = [0.05, 0.2, 0.5, 1.0, 2.0, 5.0];

/// Sizes of the velocities that are tried at each, m/s and rad/s: T need not be quadratic in v, and then M = ∂²T/∂v∂v depends on it.
const SPEEDS: [f64; 3] = [0.0, 0.1, 1.0];

/// A fault at the coordinate of `[lagrangian]` that nothing accelerates: M is not positive definite at any of some generic
/// states at which it is finite. Other text models pass, those too that are singular at some states only.
pub(super) fn check(root: &Section, mechanics: &dyn Mechanics, p: &[f64], faults: &mut Faults) {
    let Some(section) =
        root.get("lagrangian")
            .and(root.section("lagrangian", "[lagrangian]", faults))
    else {
        return;
    };
    let n = mechanics.nv();
    let mut work = mechanics.workspace();
    let mut mass = DMatrix::zeros(n, n);
    let mut culprit = None;
    for (size, speed) in SIZES
        .iter()
        .flat_map(|size| SPEEDS.map(|speed| (size, speed)))
    {
        let generic = |seed: f64| (0..n).map(move |i| 1.0 + (seed + 1.7 * i as f64 + size).sin());
        let q: Vec<f64> = generic(1.0).map(|x| size * x / 2.0).collect();
        let v: Vec<f64> = generic(2.6).map(|x| speed * x / 2.0).collect();
        mechanics.mass_matrix_at_into(&q, &v, p, &mut work, &mut mass);
        if mass.iter().any(|x| !x.is_finite()) {
            continue;
        }
        let Some((coordinate, value, still)) = unmoved(&mass) else {
            return;
        };
        let faster: Vec<f64> = v.iter().zip(&still).map(|(v, still)| v + still).collect();
        let gained = mechanics.kinetic_energy_with(&q, &faster, p)
            - mechanics.kinetic_energy_with(&q, &v, p);
        let linear = value.abs() <= SINGULAR && gained.abs() > 1e-9 * mass.amax();
        culprit = Some((coordinate, value, linear));
    }
    let Some((index, value, linear)) = culprit else {
        return;
    };
    let name = mechanics.coordinates().get(index).map_or("", |c| &c.name);
    let suspects: Vec<String> = mechanics
        .parameters()
        .iter()
        .zip(p)
        .filter(|(parameter, x)| parameter.role == Role::Constant && **x <= 0.0)
        .map(|(parameter, x)| format!("{} = {x}", quoted(&parameter.name)))
        .collect();
    let with = match suspects.is_empty() {
        true => String::new(),
        false => format!(" with {}", suspects.join(", ")),
    };
    let what = match value < -SINGULAR {
        true => "has a negative mass in T",
        false => "moves no mass in T, alone or together with others",
    };
    let cure = match linear {
        true => format!(
            "T has `{name}_dot` in the first power only, where a mass has its square: write 0.5*m*{name}_dot^2"
        ),
        false => {
            "give its masses and inertias positive values, or leave the coordinate out".to_owned()
        }
    };
    let offset = section
        .strings("coordinates", faults)
        .and_then(|list| list.iter().find(|c| c.value == name).map(|c| c.offset()));
    faults.at(
        offset.unwrap_or(section.offset),
        format!(
            "coordinate {} {what}{with}: the mass matrix is not positive definite at any state tried, and no force gives a \
             definite acceleration; {cure}",
            quoted(name)
        ),
    );
}

/// Where M is not positive definite: the coordinate that has most of the motion without inertia, the least eigenvalue of M scaled to
/// 1 on its diagonal, and that motion.
fn unmoved(mass: &DMatrix<f64>) -> Option<(usize, f64, Vec<f64>)> {
    let n = mass.nrows();
    if n == 0 {
        return None;
    }
    let scale = |i: usize| mass[(i, i)].abs().sqrt();
    if let Some(i) = (0..n).find(|&i| mass[(i, i)] <= 0.0) {
        let mut still = vec![0.0; n];
        still[i] = 1.0;
        let value = if mass[(i, i)] < 0.0 { -1.0 } else { 0.0 };
        return Some((i, value, still));
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| mass[(i, j)] / (scale(i) * scale(j)));
    let eigen = SymmetricEigen::new(scaled);
    let least = eigen.eigenvalues.imin();
    let value = eigen.eigenvalues[least];
    if value > SINGULAR {
        return None;
    }
    let vector = eigen.eigenvectors.column(least);
    let still = (0..n).map(|i| vector[i] / scale(i)).collect();
    Some((vector.iamax(), value, still))
}
