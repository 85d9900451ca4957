//! A configuration at which masses are compared.

use lagrange::Mechanics;
use lagrange::state::neutral;
use nalgebra::{Cholesky, DMatrix};

use crate::entries::starts;

/// What one-number coordinates are, m or rad, where M has no inverse at zero.
const AWAY: f64 = 0.5;

/// The neutral configuration, or where something moves no mass there, as a load on a rope of no length, one half away from it in all coordinates of one number; and M there.
pub(crate) fn typical(mechanics: &dyn Mechanics) -> (Vec<f64>, Option<DMatrix<f64>>) {
    let coordinates = mechanics.coordinates();
    let mass = |q: &[f64]| {
        let mass = mechanics.mass_matrix(q).ok()?;
        Cholesky::new(mass.clone()).is_some().then_some(mass)
    };
    let q = neutral(coordinates);
    if let Some(mass) = mass(&q) {
        return (q, Some(mass));
    }
    let mut away = q.clone();
    for (at, coordinate) in starts(coordinates).iter().zip(coordinates) {
        if !coordinate.floating {
            away[at.q] = AWAY;
        }
    }
    match mass(&away) {
        Some(mass) => (away, Some(mass)),
        None => {
            let mass = mechanics.mass_matrix(&q).ok();
            (q, mass)
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::*;
    use crate::model::Model;

    fn of(kinetic: &str) -> (Vec<f64>, Option<DMatrix<f64>>) {
        let text = format!(
            "name = \"crane\"\n[lagrangian]\ncoordinates = [\"trolley\", \"rope\", \"swing\"]\nkinetic = \"{kinetic}\"\npotential = \"0\"\n"
        );
        typical(
            &*Model::parse(Path::new("crane.toml"), text)
                .unwrap()
                .mechanics,
        )
    }

    #[test]
    fn a_load_on_a_rope_of_no_length_is_compared_where_the_rope_has_one() {
        let along = "4*trolley_dot^2 + 0.5*rope_dot^2";
        let (q, mass) = of(&format!("{along} + swing_dot^2"));
        assert_eq!((q, mass.unwrap()[(2, 2)]), (vec![0.0; 3], 2.0));
        let (q, mass) = of(&format!("{along} + 2*(rope*swing_dot)^2"));
        assert_eq!((q, mass.unwrap()[(2, 2)]), (vec![AWAY; 3], 1.0));
    }
}
