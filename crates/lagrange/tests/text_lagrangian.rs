//! Mechanisms whose energies are text: against closed forms, and what is said about faulty ones.

use std::path::Path;

use approx::assert_relative_eq;
use lagrange::{Field, Lagrangian, Role, TextLagrangian, TextProblem, TextSource};
use num_dual::Dual64;
use serde_json::Value;

fn source(
    coordinates: &[&str],
    angles: &[&str],
    kinetic: &str,
    potential: &str,
    parameters: &[(&str, f64)],
) -> TextSource {
    TextSource {
        coordinates: coordinates.iter().map(|s| s.to_string()).collect(),
        angles: angles.iter().map(|s| s.to_string()).collect(),
        kinetic: kinetic.into(),
        potential: potential.into(),
        parameters: parameters.iter().map(|&(n, x)| (n.into(), x)).collect(),
        ..TextSource::default()
    }
}

/// An elastic pendulum, r from the pivot, theta from hanging.
fn elastic_pendulum() -> TextSource {
    source(
        &["r", "theta"],
        &["theta"],
        "m*(r^2*theta_dot^2 + r_dot^2)/2",
        "-g*m*r*cos(theta) + k*(r - r_0)^2/2",
        &[("m", 0.5), ("k", 40.0), ("r_0", 0.3), ("g", 9.81)],
    )
}

fn build(source: &TextSource) -> TextLagrangian {
    TextLagrangian::new(source).unwrap_or_else(|problems| {
        let list: Vec<String> = problems.iter().map(|p| p.render(source)).collect();
        panic!("{}", list.join("\n"))
    })
}

fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect()
}

/// M from T alone: M_ij = T(e_i + e_j) − T(e_i) − T(e_j).
fn mass_matrix(lagrangian: &TextLagrangian, q: &[f64]) -> Vec<Vec<f64>> {
    let n = q.len();
    let kinetic = |i: usize, j: usize, both: bool| {
        let mut v = vec![0.0; n];
        v[i] += 1.0;
        if both {
            v[j] += 1.0;
        }
        lagrangian.kinetic(q, &v)
    };
    (0..n)
        .map(|i| {
            (0..n)
                .map(|j| kinetic(i, j, true) - kinetic(i, i, false) - kinetic(j, j, false))
                .collect()
        })
        .collect()
}

/// Compares with `closed_<name>.json`: energies at every state, M by polarisation, G by dual numbers.
fn agrees_with_closed_form(name: &str, angles: &[&str], kinetic: &str, potential: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared/oracles")
        .join(format!("closed_{name}.json"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("SKIPPED {name}: no {}", path.display());
        return;
    };
    let oracle: Value = serde_json::from_str(&text).unwrap();
    let coordinates: Vec<&str> = oracle["coordinates"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c.as_str().unwrap().trim_end_matches("(t)"))
        .collect();
    let parameters: Vec<(&str, f64)> = oracle["parameters"]
        .as_object()
        .unwrap()
        .iter()
        .map(|(name, x)| (name.as_str(), x.as_f64().unwrap()))
        .collect();
    let mechanism = build(&source(
        &coordinates,
        angles,
        kinetic,
        potential,
        &parameters,
    ));
    assert!(mechanism.kinetic_is_quadratic(), "{name}");
    assert!(
        mechanism.warnings().is_empty(),
        "{name}: {:?}",
        mechanism.warnings()
    );
    let p: Vec<f64> = mechanism.parameters().iter().map(|p| p.nominal).collect();
    let states = oracle["states"].as_array().unwrap();
    assert!(states.len() >= 10);
    for state in states {
        let (q, v) = (numbers(&state["q"]), numbers(&state["v"]));
        let close = |found: f64, expected: &Value| {
            assert_relative_eq!(
                found,
                expected.as_f64().unwrap(),
                max_relative = 1e-12,
                epsilon = 1e-12
            );
        };
        close(mechanism.kinetic(&q, &v), &state["KE"]);
        close(mechanism.potential(&q), &state["PE"]);
        close(mechanism.kinetic_with(&q, &v, &p), &state["KE"]);
        close(mechanism.potential_with(&q, &p), &state["PE"]);
        for (i, row) in mass_matrix(&mechanism, &q).iter().enumerate() {
            for (j, &entry) in row.iter().enumerate() {
                close(entry, &state["M"][i][j]);
            }
            let mut dual: Vec<Dual64> = q.iter().map(|&x| Dual64::from_re(x)).collect();
            dual[i].eps = 1.0;
            close(mechanism.potential(&dual).eps, &state["G"][i]);
        }
    }
}

#[test]
fn cart_pole_agrees_with_its_closed_form() {
    agrees_with_closed_form(
        "cartpole_table2",
        &["phi"],
        "0.5*m_c*x_dot^2 + 0.5*(m_p*l^2/12)*phi_dot^2
         + 0.5*m_p*((x_dot + l/2*cos(phi)*phi_dot)^2 + (l/2*sin(phi)*phi_dot)^2)
         + 0.5*m_s*((x_dot + l*cos(phi)*phi_dot)^2 + (l*sin(phi)*phi_dot)^2)",
        "(m_p/2 + m_s)*g*l*cos(phi)",
    );
}

#[test]
fn double_pendulum_agrees_with_its_closed_form() {
    agrees_with_closed_form(
        "double_pendulum",
        &["theta1", "theta2"],
        "(I_1 + m_1*c_1^2)*theta1_dot^2/2 + I_2*theta2_dot^2/2
         + m_2/2*(l_1^2*theta1_dot^2 + 2*l_1*c_2*cos(theta1 - theta2)*theta1_dot*theta2_dot + c_2^2*theta2_dot^2)",
        "-g*(m_1*c_1*cos(theta1) + m_2*(l_1*cos(theta1) + c_2*cos(theta2)))",
    );
}

#[test]
fn triple_pendulum_with_relative_angles_agrees_with_its_closed_form() {
    let a1 = "alpha1";
    let a2 = "(alpha1 + alpha2)";
    let a3 = "(alpha1 + alpha2 + alpha3)";
    let w2 = "(alpha1_dot + alpha2_dot)";
    let w3 = "(alpha1_dot + alpha2_dot + alpha3_dot)";
    let speed = |f: &str, links: usize| {
        let terms = [
            format!("l_1*alpha1_dot*{f}({a1})"),
            format!("l_2*{w2}*{f}{a2}"),
            format!("l_3*{w3}*{f}{a3}"),
        ];
        terms[..links].join(" + ")
    };
    let kinetic: Vec<String> = (1..=3)
        .map(|k| {
            format!(
                "m_{k}/2*(({})^2 + ({})^2)",
                speed("cos", k),
                speed("sin", k)
            )
        })
        .collect();
    let height = [
        format!("(m_1 + m_2 + m_3)*l_1*cos({a1})"),
        format!("(m_2 + m_3)*l_2*cos{a2}"),
        format!("m_3*l_3*cos{a3}"),
    ];
    agrees_with_closed_form(
        "triple_pendulum_relative",
        &["alpha1", "alpha2", "alpha3"],
        &kinetic.join(" + "),
        &format!("-g*({})", height.join(" + ")),
    );
}

#[test]
fn spherical_pendulum_agrees_with_its_closed_form() {
    agrees_with_closed_form(
        "spherical_pendulum",
        &["theta", "psi"],
        "m*l^2/2*(theta_dot^2 + (sin(theta)*psi_dot)^2)",
        "-m*g*l*cos(theta)",
    );
}

#[test]
fn furuta_pendulum_agrees_with_its_closed_form() {
    agrees_with_closed_form(
        "furuta_pendulum",
        &["theta1", "theta2"],
        "J_1*theta1_dot^2/2 + J_2/2*(theta2_dot^2 + sin(theta2)^2*theta1_dot^2)
         + m_2/2*(L_1^2*theta1_dot^2 + 2*L_1*l_2*cos(theta2)*theta1_dot*theta2_dot
                  + l_2^2*(theta2_dot^2 + sin(theta2)^2*theta1_dot^2))",
        "-m_2*g*l_2*cos(theta2)",
    );
}

#[test]
fn elastic_pendulum_agrees_with_its_closed_form() {
    let text = elastic_pendulum();
    agrees_with_closed_form(
        "elastic_pendulum",
        &["theta"],
        &text.kinetic,
        &text.potential,
    );
}

#[test]
fn coordinates_and_parameters_are_those_of_the_source() {
    let mechanism = build(&elastic_pendulum());
    let units: Vec<(&str, &str, bool)> = mechanism
        .coordinates()
        .iter()
        .map(|c| (c.name.as_str(), c.unit(), c.wraps))
        .collect();
    assert_eq!(units, [("r", "m", false), ("theta", "rad", true)]);
    assert!(mechanism.coordinates().iter().all(|c| c.joint == c.name));
    let parameters: Vec<(&str, f64)> = mechanism
        .parameters()
        .iter()
        .map(|p| (p.name.as_str(), p.nominal))
        .collect();
    assert_eq!(
        parameters,
        [("m", 0.5), ("k", 40.0), ("r_0", 0.3), ("g", 9.81)]
    );
    assert!(
        mechanism
            .parameters()
            .iter()
            .all(|p| p.role == Role::Constant)
    );
}

#[test]
fn energies_follow_the_parameters_given_to_them() {
    let mechanism = build(&elastic_pendulum());
    let (q, v) = ([0.5, 0.2], [1.0, 2.0]);
    let mut p: Vec<Dual64> = mechanism
        .parameters()
        .iter()
        .map(|p| Dual64::from_re(p.nominal))
        .collect();
    p[1] = Dual64::new(50.0, 1.0);
    let potential = mechanism.potential_with(&q.map(Dual64::from_re), &p);
    assert_relative_eq!(
        potential.re - mechanism.potential(&q),
        0.5 * 10.0 * 0.04,
        epsilon = 1e-14
    );
    assert_relative_eq!(potential.eps, 0.5 * 0.04, max_relative = 1e-14);
    p[0].eps = 1.0;
    let kinetic = mechanism.kinetic_with(&q.map(Dual64::from_re), &v.map(Dual64::from_re), &p);
    assert_relative_eq!(
        kinetic.eps,
        mechanism.kinetic(&q, &v) / 0.5,
        max_relative = 1e-14
    );
}

#[test]
fn only_a_quadratic_form_counts_as_one() {
    for (kinetic, expected) in [
        ("x_dot^2 + y_dot^2", true),
        ("(x_dot + sin(x)*y_dot)^2", true),
        ("x_dot^2 - 3*x_dot*y_dot", true),
        ("1e-9*x_dot^2 + 1e9*y_dot^2", true),
        ("0*x_dot*y_dot", true),
        ("x_dot^2 + y_dot^2 + 0.01", false),
        ("x_dot^2 + y_dot^2 + 0.001*x_dot", false),
        ("x_dot^2 + y_dot^4", false),
        ("1e8*x_dot^2 + 1e-8*y_dot^4", false),
        ("abs(x_dot*y_dot)", false),
        ("sqrt(x_dot^4 + y_dot^4)", false),
        ("x_dot^3/y_dot", false),
        ("1 - sqrt(1 - 0.01*(x_dot^2 + y_dot^2))", false),
    ] {
        let mechanism = build(&source(&["x", "y"], &[], kinetic, "0", &[]));
        assert_eq!(mechanism.kinetic_is_quadratic(), expected, "{kinetic}");
    }
}

/// A wheel on a turntable has a part of T without velocities, a charge in a field one with a single one: no slips.
#[test]
fn a_kinetic_energy_that_is_cubic_in_the_velocities_is_warned_of() {
    let warned = |kinetic: &str| {
        let mechanism = build(&source(&["x"], &[], kinetic, "0", &[]));
        let told = mechanism.warnings().iter();
        told.map(|w| w.message.clone()).collect::<Vec<_>>()
    };
    for kinetic in ["0.5*x_dot^2 + sin(x)^2", "0.5*x_dot^2 + x*x_dot"] {
        assert!(warned(kinetic).is_empty(), "{kinetic}");
    }
    let of_cube = warned("0.5*x_dot^2 + 0.1*x_dot^3");
    assert!(
        of_cube.len() == 1 && of_cube[0].contains("exponent"),
        "{of_cube:?}"
    );
}

#[test]
fn what_nothing_uses_is_a_warning() {
    let mut text = elastic_pendulum();
    text.parameters.push(("drag".into(), 1.0));
    text.coordinates.push("s".into());
    let mechanism = build(&text);
    let warnings: Vec<(Field, bool)> = mechanism
        .warnings()
        .iter()
        .map(|w| {
            (
                w.field,
                w.message.contains("`s_dot`") || w.message.contains("`drag`"),
            )
        })
        .collect();
    assert_eq!(
        warnings,
        [(Field::Kinetic, true), (Field::Parameter(4), true)]
    );
}

fn problems(source: &TextSource) -> Vec<TextProblem> {
    TextLagrangian::new(source).expect_err("accepted")
}

#[test]
fn every_fault_has_its_field_and_column() {
    let x = |kinetic: &str, potential: &str, parameters: &[(&str, f64)]| {
        source(&["x"], &[], kinetic, potential, parameters)
    };
    let t = "x_dot^2";
    for (text, field, column, fragment) in [
        (
            x(t, "x*x_dot", &[]),
            Field::Potential,
            Some(3),
            "`x_dot` is a velocity",
        ),
        (
            x("x_dt^2", "x", &[]),
            Field::Kinetic,
            Some(1),
            "did you mean `x_dot`",
        ),
        (
            x(t, "k*x^2", &[("K", 1.0)]),
            Field::Potential,
            Some(1),
            "did you mean `K`",
        ),
        (x(t, "", &[]), Field::Potential, Some(1), "empty"),
        (x("", "x", &[]), Field::Kinetic, Some(1), "empty"),
        (
            x(t, "x", &[("sin", 1.0)]),
            Field::Parameter(0),
            None,
            "`sin` is a function",
        ),
        (
            x(t, "x", &[("e", 0.5)]),
            Field::Parameter(0),
            None,
            "`e` is a constant",
        ),
        (
            x(t, "x", &[("x", 0.5)]),
            Field::Parameter(0),
            None,
            "taken by coordinates[0]",
        ),
        (
            x(t, "x", &[("k", 0.5), ("k", 1.0)]),
            Field::Parameter(1),
            None,
            "taken by parameters[0]",
        ),
        (
            x(t, "x", &[("x_dot", 1.0)]),
            Field::Parameter(0),
            None,
            "velocity of the coordinate `x`",
        ),
        (
            x(t, "x", &[("2k", 0.5)]),
            Field::Parameter(0),
            None,
            "`2k` is not a name",
        ),
        (
            x(t, "x", &[("a b", 0.5)]),
            Field::Parameter(0),
            None,
            "`a b` is not a name",
        ),
        (
            x(t, "x", &[("", 0.5)]),
            Field::Parameter(0),
            None,
            "`` is not a name",
        ),
        (
            x(t, "k*x", &[("k", f64::NAN)]),
            Field::Parameter(0),
            None,
            "`k` is NaN",
        ),
        (
            x(t, "k*x", &[("k", f64::INFINITY)]),
            Field::Parameter(0),
            None,
            "`k` is inf",
        ),
        (
            x("x_dot^2*sqrt(-x)", "x", &[]),
            Field::Kinetic,
            None,
            "T is NaN or infinite",
        ),
        (
            x(t, "ln(x - 5)", &[]),
            Field::Potential,
            None,
            "V is NaN or infinite",
        ),
        (
            x(t, "x/m", &[("m", 0.0)]),
            Field::Potential,
            None,
            "V is NaN or infinite",
        ),
        (
            source(&[], &[], "0", "0", &[]),
            Field::Coordinates(0),
            None,
            "no coordinate",
        ),
        (
            source(&["x", "x"], &[], t, "0", &[]),
            Field::Coordinates(1),
            None,
            "taken by coordinates[0]",
        ),
        (
            source(&["x", "x_dot"], &[], t, "0", &[]),
            Field::Coordinates(1),
            None,
            "velocity of the coordinate `x`",
        ),
        (
            source(&["φ"], &[], "0", "0", &[]),
            Field::Coordinates(0),
            None,
            "not a name",
        ),
        (
            source(&["phi"], &["fhi"], "phi_dot^2", "0", &[]),
            Field::Angles(0),
            None,
            "did you mean `phi`",
        ),
        (
            source(&["phi"], &["phi", "phi"], "phi_dot^2", "0", &[]),
            Field::Angles(1),
            None,
            "twice",
        ),
    ] {
        let found = problems(&text);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (found[0].field, found[0].column),
            (field, column),
            "{}",
            found[0]
        );
        assert!(found[0].message.contains(fragment), "{}", found[0]);
    }
}

#[test]
fn all_faults_are_reported_at_once() {
    let text = source(
        &["x", "cos"],
        &["y"],
        "m*x_dot^2 + oops",
        "x_dot + *",
        &[("m", f64::NAN), ("x", 1.0)],
    );
    let fields: Vec<(Field, Option<usize>)> = problems(&text)
        .iter()
        .map(|p| (p.field, p.column))
        .collect();
    assert_eq!(
        fields,
        [
            (Field::Coordinates(1), None),
            (Field::Parameter(1), None),
            (Field::Parameter(0), None),
            (Field::Angles(0), None),
            (Field::Kinetic, Some(13)),
            (Field::Potential, Some(9)),
        ]
    );
}

#[test]
fn a_problem_is_shown_with_a_caret() {
    let text = source(&["x"], &[], "0.5*m*x_dot^2", "x", &[]);
    assert_eq!(
        problems(&text)[0].render(&text),
        "kinetic, column 5: unknown name `m`; known are x, x_dot, pi, e\n0.5*m*x_dot^2\n    ^"
    );
}

/// A point mass in a vertical plane on a rod.
fn rod(constraints: &[&str]) -> TextSource {
    TextSource {
        constraints: constraints.iter().map(|s| s.to_string()).collect(),
        ..source(
            &["x", "z"],
            &[],
            "0.5*m*(x_dot^2 + z_dot^2)",
            "m*g*z",
            &[("m", 0.2), ("g", 9.81), ("l", 0.5)],
        )
    }
}

#[test]
fn a_constraint_is_a_formula_or_an_equation() {
    use lagrange::constraint::Constraint;
    for text in ["x^2 + z^2 - l^2", "x^2 + z^2 = l^2", "x^2 = l^2 - z^2"] {
        let lagrangian = build(&rod(&[text]));
        assert!(lagrangian.warnings().is_empty());
        let mut phi = [0.0_f64];
        lagrangian.constraints().residual(&[0.3, 0.1], &mut phi);
        assert!((phi[0] + 0.15).abs() < 1e-15, "{text}");
        // The derivative along the constant l.
        let constant = |x: f64| Dual64::from_re(x);
        let p = [constant(0.2), constant(9.81), Dual64::new(0.5, 1.0)];
        let mut phi = [constant(0.0)];
        let q = [constant(0.3), constant(0.1)];
        lagrangian.constraints().residual_with(&q, &p, &mut phi);
        assert!((phi[0].eps + 1.0).abs() < 1e-15, "{text}");
    }
}

#[test]
fn faulty_constraints_are_shown_with_column_and_cure() {
    let said = |text: &str| {
        let source = rod(&["x - z", text]);
        let problems = TextLagrangian::new(&source).unwrap_err();
        assert!(
            problems.iter().all(|p| p.field == Field::Constraint(1)),
            "{problems:?}"
        );
        problems[0].render(&source)
    };
    assert_eq!(
        said("x^2 + zz^2 - l^2"),
        "constraints[1], column 7: unknown name `zz`; did you mean `z`?\nx^2 + zz^2 - l^2\n      ^"
    );
    let moving = said("x = l*cos(z_dot)");
    assert!(
        moving.starts_with("constraints[1], column 11: `z_dot` is a velocity: a holonomic constraint depends on the coordinates alone"),
        "{moving}"
    );
    assert!(
        moving.ends_with("x = l*cos(z_dot)\n          ^"),
        "{moving}"
    );
    assert!(said("x = l + k").starts_with("constraints[1], column 9: unknown name `k`"));
    assert!(said("x^2 > l").starts_with("constraints[1], column 5: a constraint is an equation"));
    assert!(said("x = z = l").starts_with("constraints[1], column 7: a second `=`"));
    assert!(said("x =").starts_with("constraints[1], column 3: nothing stands"));
    assert!(said("l^2 - 0.25").contains("no coordinate stands in it"));
    assert!(said("sqrt(-1 - x^2)").contains("φ is NaN or infinite"));
    assert!(said("").contains("column 1"));
}
