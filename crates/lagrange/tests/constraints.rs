//! Mechanisms under holonomic constraints, against closed forms and against the same mechanisms in independent coordinates.

use integrators::Rk4;
use lagrange::constraint::{Constrained, Constraint};
use lagrange::{Dynamics, Error, ForwardDynamicsDerivatives, Lagrangian, Mechanics, Scalar};
use lagrange::{TextLagrangian, TextSource};
use nalgebra::{DMatrix, DVector};

const G: f64 = 9.81;

/// Point masses in a vertical plane, q = (x₁, z₁, x₂, z₂, …).
#[derive(Debug)]
struct Masses(Vec<f64>);

impl Lagrangian for Masses {
    fn dof(&self) -> usize {
        2 * self.0.len()
    }
    fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
        let energy =
            |(i, m): (usize, &f64)| (v[2 * i] * v[2 * i] + v[2 * i + 1] * v[2 * i + 1]) * (0.5 * m);
        self.0
            .iter()
            .enumerate()
            .map(energy)
            .fold(D::zero(), |a, b| a + b)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        let energy = |(i, m): (usize, &f64)| q[2 * i + 1] * (m * G);
        self.0
            .iter()
            .enumerate()
            .map(energy)
            .fold(D::zero(), |a, b| a + b)
    }
}

/// A rod from the origin to mass 0, and one from each mass to the next; φ = ½ (|d|² − l²) or, `as_distance`, |d| − l.
struct Rods {
    lengths: Vec<f64>,
    as_distance: bool,
}

impl Constraint for Rods {
    fn len(&self) -> usize {
        self.lengths.len()
    }
    fn name(&self, equation: usize) -> String {
        format!("rod {equation}")
    }
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        for (i, &l) in self.lengths.iter().enumerate() {
            let (mut x, mut z) = (q[2 * i], q[2 * i + 1]);
            if i > 0 {
                (x, z) = (x - q[2 * i - 2], z - q[2 * i - 1]);
            }
            let square = x * x + z * z;
            out[i] = if self.as_distance {
                square.sqrt() - l
            } else {
                (square - l * l) * 0.5
            };
        }
    }
}

fn pendulum(as_distance: bool) -> Constrained<Dynamics<Masses>, Rods> {
    let rods = Rods {
        lengths: vec![0.5],
        as_distance,
    };
    Constrained::near(Dynamics::of(Masses(vec![2.0])), rods, &[0.1, -0.5]).unwrap()
}

#[test]
fn a_point_mass_on_a_rod_is_a_pendulum() {
    let (m, l) = (2.0, 0.5);
    for as_distance in [true, false] {
        let pendulum = pendulum(as_distance);
        for (angle, rate) in [(0.3, 1.2), (2.0, -3.0), (-1.4, 0.0), (3.1, 7.0)] {
            // Angle from hanging: x = l sin, z = −l cos.
            let (s, c) = f64::sin_cos(angle);
            let (q, v) = ([l * s, -l * c], [l * c * rate, l * s * rate]);
            let (a, multipliers) = pendulum
                .forward_dynamics_with_multipliers(&q, &v, &[0.0, 0.0])
                .unwrap();
            let angular = -G / l * s;
            assert!((a[0] - l * (c * angular - s * rate * rate)).abs() < 1e-12);
            assert!((a[1] - l * (s * angular + c * rate * rate)).abs() < 1e-12);
            // The tension m (g cos + l rate²) pulls towards the origin: Jᵀ λ = −tension · radial. The unit vector is J of the
            // distance, and J / l of the half square.
            let tension = m * (G * c + l * rate * rate);
            let expected = if as_distance { -tension } else { -tension / l };
            assert!(
                (multipliers[0] - expected).abs() < 1e-11,
                "{} {expected}",
                multipliers[0]
            );
            // On φ = 0, φ̇ = 0 stabilisation adds nothing.
            let stabilised = pendulum.forward_dynamics(&q, &v, &[0.0, 0.0]).unwrap();
            assert!((stabilised - a).amax() < 1e-11);
        }
    }
}

/// M v̇ + C v + G − Q − Jᵀ λ at the returned v̇ and λ.
fn imbalance<M: Mechanics, C: Constraint>(
    mechanism: &Constrained<M, C>,
    q: &[f64],
    v: &[f64],
    force: &[f64],
) -> (f64, f64) {
    let (a, multipliers) = mechanism
        .forward_dynamics_with_multipliers(q, v, force)
        .unwrap();
    let needed = mechanism.inverse_dynamics(q, v, a.as_slice()).unwrap();
    let jacobian = mechanism.jacobian(q).unwrap();
    let given = DVector::from_column_slice(force) + jacobian.transpose() * &multipliers;
    // φ̈ by differences of φ̇ = J v along the motion.
    let h = 1e-5;
    let rate = |h: f64| {
        let q: Vec<f64> = (0..q.len())
            .map(|i| q[i] + h * v[i] + 0.5 * h * h * a[i])
            .collect();
        let v: Vec<f64> = (0..v.len()).map(|i| v[i] + h * a[i]).collect();
        mechanism.jacobian(&q).unwrap() * DVector::from_vec(v)
    };
    let acceleration = (rate(h) - rate(-h)) / (2.0 * h);
    ((needed - given).amax(), acceleration.amax())
}

#[test]
fn forces_balance_and_the_constraint_does_not_accelerate() {
    let rods = Rods {
        lengths: vec![0.5, 0.3, 0.4],
        as_distance: true,
    };
    let free = Dynamics::of(Masses(vec![2.0, 0.7, 1.1]));
    let chain = Constrained::near(free, rods, &[0.1, -0.5, 0.2, -0.8, 0.1, -1.1]).unwrap();
    let (q, v) = chain
        .project(
            &[0.3, -0.4, 0.4, -0.7, 0.2, -1.0],
            &[1.0, 0.3, -2.0, 0.4, 0.1, 1.0],
        )
        .unwrap();
    assert!(chain.residual(&q).unwrap().amax() < 1e-14);
    assert!((chain.jacobian(&q).unwrap() * DVector::from_vec(v.clone())).amax() < 1e-13);
    let force = [0.3, -1.0, 2.0, 0.1, -0.7, 0.5];
    let (force, acceleration) = imbalance(&chain, &q, &v, &force);
    assert!(force < 1e-12, "{force:e}");
    assert!(acceleration < 1e-7, "{acceleration:e}");
}

fn derivatives<M: Mechanics>(
    mechanism: &M,
    (q, v, force): (&[f64], &[f64], &[f64]),
    p: &[f64],
    constants: &[usize],
) -> ForwardDynamicsDerivatives {
    let mut out = ForwardDynamicsDerivatives::zeros(v.len(), constants.len());
    let mut work = mechanism.workspace();
    mechanism
        .forward_dynamics_derivatives_into(q, v, force, p, constants, &mut work, &mut out)
        .unwrap();
    out
}

/// Central differences of order 4.
fn difference(f: impl Fn(f64) -> DVector<f64>, h: f64) -> DVector<f64> {
    ((f(h) - f(-h)) * 8.0 - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

fn check_derivatives<M: Mechanics>(
    mechanism: &M,
    (q, v, force): (&[f64], &[f64], &[f64]),
    tolerance: f64,
) {
    crate::rows::assert_product(mechanism, (q, v, force));
    let p = mechanism.nominal();
    let constants: Vec<usize> = (0..p.len()).collect();
    let at = derivatives(mechanism, (q, v, force), &p, &constants);
    let acceleration = |q: &[f64], v: &[f64], force: &[f64], p: &[f64]| {
        let mut out = DVector::from_column_slice(force);
        let mut work = mechanism.workspace();
        mechanism
            .forward_dynamics_into(q, v, p, &mut work, &mut out)
            .unwrap();
        out
    };
    assert!((acceleration(q, v, force, &p) - &at.acceleration).amax() < 1e-12);
    let stepped = |x: &[f64], j: usize, h: f64| {
        let mut x = x.to_vec();
        x[j] += h;
        x
    };
    let h = 1e-3;
    let compare = |exact: &DMatrix<f64>, j: usize, name: &str, f: &dyn Fn(f64) -> DVector<f64>| {
        let numeric = difference(f, h);
        let error = (exact.column(j) - &numeric).amax() / (1.0 + numeric.amax());
        assert!(error < tolerance, "{name}[{j}]: {error:e}");
    };
    for j in 0..v.len() {
        compare(&at.by_q, j, "q", &|h| {
            acceleration(&stepped(q, j, h), v, force, &p)
        });
        compare(&at.by_v, j, "v", &|h| {
            acceleration(q, &stepped(v, j, h), force, &p)
        });
        compare(&at.by_force, j, "Q", &|h| {
            acceleration(q, v, &stepped(force, j, h), &p)
        });
    }
    for j in 0..p.len() {
        compare(&at.by_p, j, "p", &|h| {
            acceleration(q, v, force, &stepped(&p, j, h))
        });
    }
    assert!((&at.by_force - at.by_force.transpose()).amax() < 1e-12 * (1.0 + at.by_force.amax()));
}

#[test]
fn derivatives_of_the_constrained_acceleration_are_exact() {
    let rods = Rods {
        lengths: vec![0.5, 0.3, 0.4],
        as_distance: true,
    };
    let free = Dynamics::of(Masses(vec![2.0, 0.7, 1.1]));
    let chain = Constrained::near(free, rods, &[0.1, -0.5, 0.2, -0.8, 0.1, -1.1]).unwrap();
    let (q, v) = chain
        .project(
            &[0.3, -0.4, 0.4, -0.7, 0.2, -1.0],
            &[1.0, 0.3, -2.0, 0.4, 0.1, 1.0],
        )
        .unwrap();
    let force = [0.3, -1.0, 2.0, 0.1, -0.7, 0.5];
    check_derivatives(&chain, (&q, &v, &force), 1e-7);
    // Away from φ = 0 too, where the stabilisation pulls.
    check_derivatives(
        &chain,
        (
            &[0.3, -0.4, 0.45, -0.7, 0.2, -1.0],
            &[0.1, 0.2, 0.3, 1.0, 2.0, -1.0],
            &force,
        ),
        1e-6,
    );
}

/// Two masses in a plane, the first on a rod of length l and the second on one of length r with a spring: constants of the energies,
/// of the constraints, of both.
#[test]
fn derivatives_in_the_constants_of_constraints_written_as_text_are_exact() {
    let text = TextLagrangian::new(&TextSource {
        coordinates: ["x", "z", "y", "h"].map(Into::into).to_vec(),
        kinetic: "0.5*m*(x_dot^2 + z_dot^2) + 0.5*M*(1 + 0.2*sin(x)^2)*(y_dot^2 + h_dot^2)".into(),
        potential: "m*g*z + M*g*h + 0.5*k*(x - y)^2 + r*x*h".into(),
        constraints: vec![
            "x^2 + z^2 = l^2".into(),
            "sqrt((x - y)^2 + (z - h)^2) - r".into(),
        ],
        parameters: [
            ("m", 0.2),
            ("M", 0.7),
            ("g", 9.81),
            ("k", 3.0),
            ("l", 0.5),
            ("r", 0.4),
        ]
        .map(|(name, x)| (name.into(), x))
        .to_vec(),
        ..TextSource::default()
    })
    .unwrap();
    let constraints = text.constraints().clone();
    let coordinates = text.coordinates().to_vec();
    let rods = Constrained::near(
        Dynamics::new(text, coordinates).unwrap(),
        constraints,
        &[0.3, -0.4, 0.3, -0.8],
    )
    .unwrap();
    assert_eq!(rods.constraint().len(), 2);
    let uses: Vec<bool> = (0..6).map(|k| rods.constraint().uses_constant(k)).collect();
    assert_eq!(uses, [false, false, false, false, true, true]);
    let force = [0.3, -1.0, 2.0, 0.1];
    let off = ([0.35, -0.4, 0.5, -0.7], [0.8, 0.3, -1.0, 0.5]);
    let (q, v) = rods.project(&off.0, &off.1).unwrap();
    check_derivatives(&rods, (&q, &v, &force), 1e-7);
    check_derivatives(&rods, (&off.0, &off.1, &force), 1e-6);
}

/// The largest |φ|, |φ̇| and relative change of energy over `steps` of `h`.
fn drift<M: Mechanics, C: Constraint>(
    mechanism: &Constrained<M, C>,
    q: &[f64],
    v: &[f64],
    h: f64,
    steps: usize,
) -> (f64, f64, f64) {
    let n = v.len();
    let p = mechanism.nominal();
    let mut work = mechanism.workspace();
    let mut a = DVector::zeros(n);
    let mut rk4 = Rk4::new(2 * n);
    let mut x: Vec<f64> = q.iter().chain(v).copied().collect();
    let start = mechanism.total_energy(q, v).unwrap();
    let (mut open, mut opening, mut energy, mut moving) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for k in 0..steps {
        rk4.step(k as f64 * h, h, &mut x, |_t, x, dx| {
            let (q, v) = x.split_at(n);
            a.fill(0.0);
            mechanism.forward_dynamics_into(q, v, &p, &mut work, &mut a)?;
            dx[..n].copy_from_slice(v);
            dx[n..].copy_from_slice(a.as_slice());
            Ok::<(), Error>(())
        })
        .unwrap();
        if k % 10 == 9 {
            let (q, v) = x.split_at(n);
            open = open.max(mechanism.residual(q).unwrap().amax());
            let rate = mechanism.jacobian(q).unwrap() * DVector::from_column_slice(v);
            opening = opening.max(rate.amax());
            energy = energy.max((mechanism.total_energy(q, v).unwrap() - start).abs());
            moving = moving.max(mechanism.kinetic_energy(q, v).unwrap());
        }
    }
    (open, opening, energy / moving)
}

#[test]
fn stabilisation_bounds_the_drift_that_grows_without_it() {
    let state = |pendulum: &Constrained<Dynamics<Masses>, Rods>| {
        pendulum.project(&[0.5, 0.1], &[0.0, 0.0]).unwrap()
    };
    let stabilised = pendulum(true);
    let (q, v) = state(&stabilised);
    let short = drift(&stabilised, &q, &v, 5e-3, 1000);
    let long = drift(&stabilised, &q, &v, 5e-3, 8000);
    let bare = pendulum(true).with_stabilisation(0.0).unwrap();
    let unstabilised = drift(&bare, &q, &v, 5e-3, 8000);
    eprintln!("5 s {short:?}, 40 s {long:?}; without stabilisation 40 s {unstabilised:?}");
    assert!(long.0 < 2.0 * short.0 && long.1 < 2.0 * short.1);
    assert!(unstabilised.0 > 100.0 * long.0);
}

/// A relativistic particle in a plane, c = 3 m/s: T = m c² (γ − 1) in the coordinates' sense ∂T/∂v = γ³ m v along the motion.
struct Fast;

impl Lagrangian for Fast {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
        // L = −m c² √(1 − v²/c²), up to a constant.
        let c2 = 9.0;
        let square = (v[0] * v[0] + v[1] * v[1]) * (1.0 / c2);
        ((-square + 1.0).sqrt() * -1.0 + 1.0) * (2.0 * c2)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        q[1] * (2.0 * G)
    }
}

#[test]
fn a_mass_matrix_that_depends_on_velocity_is_taken_as_it_is() {
    let rods = Rods {
        lengths: vec![0.5],
        as_distance: true,
    };
    let fast = Constrained::near(Dynamics::of(Fast), rods, &[0.1, -0.5]).unwrap();
    let (m, l, c) = (2.0, 0.5, 3.0);
    let (angle, rate) = (0.6_f64, 3.5_f64);
    let (sin, cos) = angle.sin_cos();
    let (q, v) = ([l * sin, -l * cos], [l * cos * rate, l * sin * rate]);
    let (a, multipliers) = fast
        .forward_dynamics_with_multipliers(&q, &v, &[0.0, 0.0])
        .unwrap();
    // In the angle: L = −m c² √(1 − l² φ̇²/c²) − V, so γ³ m l² φ̈ = −m g l sin φ; across the motion the inertia is γ m.
    let gamma = 1.0 / (1.0 - (l * rate / c).powi(2)).sqrt();
    let angular = -G * sin / (l * gamma.powi(3));
    assert!((a[0] - l * (cos * angular - sin * rate * rate)).abs() < 1e-11);
    assert!((a[1] - l * (sin * angular + cos * rate * rate)).abs() < 1e-11);
    let tension = m * (G * cos + gamma * l * rate * rate);
    assert!((multipliers[0] + tension).abs() < 1e-10, "{multipliers}");
    check_derivatives(&fast, (&q, &v, &[0.3, -0.2]), 1e-6);
}

/// Two masses in a plane under factor · (x₀ − shift), or under what is 0 whatever q is.
#[derive(Debug)]
struct Scaled {
    factor: f64,
    shift: f64,
}
impl Constraint for Scaled {
    fn len(&self) -> usize {
        1
    }
    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        out[0] = (q[0] - self.shift) * self.factor;
    }
}

#[test]
fn a_mechanism_whose_every_constraint_is_redundant_moves_freely() {
    let always = Scaled {
        factor: 0.0,
        shift: 0.0,
    };
    let free = Dynamics::of(Masses(vec![2.0]));
    let constrained = Constrained::new(free, always).unwrap();
    assert!(constrained.names().is_empty() && constrained.dropped()[0].always);
    let (q, v, force) = ([0.3, -0.2], [1.0, 2.0], [0.5, 0.1]);
    assert_eq!(
        constrained.project(&q, &v).unwrap(),
        (q.to_vec(), v.to_vec())
    );
    let free = constrained.free().forward_dynamics(&q, &v, &force).unwrap();
    let (a, multipliers) = constrained
        .forward_dynamics_with_multipliers(&q, &v, &force)
        .unwrap();
    assert!((a - &free).amax() < 1e-12 && multipliers.is_empty());
    let a = constrained.forward_dynamics(&q, &v, &force).unwrap();
    assert!((a - free).amax() < 1e-12);
}

#[test]
fn an_equation_in_odd_units_is_kept_or_refused_and_not_called_redundant() {
    for factor in [1e-9, 1e-3, 1e20, 1e80] {
        let free = Dynamics::of(Masses(vec![2.0]));
        let constrained = Constrained::new(free, Scaled { factor, shift: 1.0 }).unwrap();
        assert!(constrained.dropped().is_empty(), "{factor:e}");
        let (q, v) = constrained.project(&[0.3, -0.2], &[1.0, 2.0]).unwrap();
        assert!((q[0] - 1.0).abs() < 1e-9 && v[0].abs() < 1e-9, "{factor:e}");
    }
    for factor in [1e-300, 1e-30, 1e200] {
        let free = Dynamics::of(Masses(vec![2.0]));
        let error = Constrained::new(free, Scaled { factor, shift: 1.0 }).unwrap_err();
        assert!(
            matches!(&error, Error::ConstraintScale { gradient, .. } if *gradient == factor),
            "{error}"
        );
    }
}
