//! The cart-pole and the double pendulum of `models/`, from their URDF and from their energies as text.

use std::path::Path;

use lagrange::mechanism::Tree;
use lagrange::urdf::Options;
use lagrange::{Dynamics, TextLagrangian, TextSource};

use super::load::tree;

/// The mechanism of a URDF under `models/`.
pub fn model(path: &str) -> Dynamics<Tree> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models")
        .join(path);
    tree(&std::fs::read_to_string(path).unwrap(), &Options::default())
}

/// The mechanism of energies written as text.
pub fn text(source: &TextSource) -> Dynamics<TextLagrangian> {
    let lagrangian = TextLagrangian::new(source).unwrap_or_else(|problems| {
        let list: Vec<String> = problems.iter().map(|p| p.render(source)).collect();
        panic!("{}", list.join("\n"))
    });
    let coordinates = lagrangian.coordinates().to_vec();
    Dynamics::new(lagrangian, coordinates).unwrap()
}

/// Cart, uniform rod, point mass at its tip; phi from upright.
pub fn cart_pole_as_text() -> Dynamics<TextLagrangian> {
    text(&TextSource {
        coordinates: names(&["x", "phi"]),
        angles: names(&["phi"]),
        kinetic: "0.5*(mc + mp + ms)*x_dot^2 + (mp/2 + ms)*l*x_dot*phi_dot*cos(phi) \
                  + 0.5*(mp/3 + ms)*l^2*phi_dot^2"
            .into(),
        potential: "(mp/2 + ms)*g*l*cos(phi)".into(),
        parameters: constants(&[
            ("mc", 0.466),
            ("mp", 0.06),
            ("ms", 0.012),
            ("l", 0.201),
            ("g", 9.81),
        ]),
        ..TextSource::default()
    })
}

/// Two bars; the elbow is the angle of the lower one against the upper.
pub fn double_pendulum_as_text() -> Dynamics<TextLagrangian> {
    text(&TextSource {
        coordinates: names(&["shoulder", "elbow"]),
        angles: names(&["shoulder", "elbow"]),
        kinetic: "0.5*(I1 + m1*c1^2)*shoulder_dot^2 + 0.5*I2*(shoulder_dot + elbow_dot)^2 \
                  + 0.5*m2*(L1^2*shoulder_dot^2 + c2^2*(shoulder_dot + elbow_dot)^2 \
                  + 2*L1*c2*shoulder_dot*(shoulder_dot + elbow_dot)*cos(elbow))"
            .into(),
        potential: "m1*g*(h - c1*cos(shoulder)) \
                    + m2*g*(h - L1*cos(shoulder) - c2*cos(shoulder + elbow))"
            .into(),
        parameters: constants(&[
            ("m1", 0.243),
            ("m2", 0.2025),
            ("L1", 0.28),
            ("c1", 0.14),
            ("c2", 0.115),
            ("I1", 1.840725e-3),
            ("I2", 1.069875e-3),
            ("h", 0.6),
            ("g", 9.81),
        ]),
        ..TextSource::default()
    })
}

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(|s| s.to_string()).collect()
}

fn constants(list: &[(&str, f64)]) -> Vec<(String, f64)> {
    list.iter().map(|&(name, x)| (name.into(), x)).collect()
}
