//! Equations of motion as formulas: as a textbook has them, and equal to the numbers wherever they are parsed or compiled again.

use std::path::Path;
use std::process::Command;

use lagrange::equations::reference;
use lagrange::{
    Coordinate, Dynamics, Expression, Formulas, FormulasError, Lagrangian, Mechanics, Scalar,
    Style, TextLagrangian, TextSource, Written, urdf,
};

fn text(
    coordinates: &[&str],
    kinetic: &str,
    potential: &str,
    parameters: &[(&str, f64)],
) -> TextLagrangian {
    let source = TextSource {
        coordinates: coordinates.iter().map(|s| s.to_string()).collect(),
        kinetic: kinetic.into(),
        potential: potential.into(),
        parameters: parameters.iter().map(|&(n, x)| (n.into(), x)).collect(),
        ..TextSource::default()
    };
    TextLagrangian::new(&source).unwrap_or_else(|problems| panic!("{problems:?}"))
}

fn cart_pole() -> TextLagrangian {
    text(
        &["x", "phi"],
        "0.5*mc*x_dot^2 + 0.5*m*((x_dot + l*cos(phi)*phi_dot)^2 + (l*sin(phi)*phi_dot)^2)",
        "m*g*l*cos(phi)",
        &[("mc", 0.47), ("m", 0.06), ("l", 0.17), ("g", 9.81)],
    )
}

/// Angles from hanging, both absolute; positions written out.
fn double_pendulum() -> TextLagrangian {
    text(
        &["theta1", "theta2"],
        "0.5*m1*l1^2*theta1_dot^2 + 0.5*m2*((l1*cos(theta1)*theta1_dot + l2*cos(theta2)*theta2_dot)^2 \
         + (l1*sin(theta1)*theta1_dot + l2*sin(theta2)*theta2_dot)^2)",
        "-(m1 + m2)*g*l1*cos(theta1) - m2*g*l2*cos(theta2)",
        &[
            ("m1", 1.2),
            ("m2", 0.7),
            ("l1", 0.4),
            ("l2", 0.9),
            ("g", 9.81),
        ],
    )
}

fn furuta_pendulum() -> TextLagrangian {
    text(
        &["arm", "phi"],
        "0.5*J*arm_dot^2 + 0.5*m*((r*arm_dot + l*cos(phi)*phi_dot)^2 + (l*sin(phi)*arm_dot)^2 + (l*sin(phi)*phi_dot)^2)",
        "m*g*l*(cos(phi) - 1)",
        &[("J", 0.02), ("m", 0.1), ("r", 0.2), ("l", 0.3), ("g", 9.81)],
    )
}

/// A bead on a wire with a spring; every function, smooth or not.
fn every_function() -> TextLagrangian {
    text(
        &["s", "u"],
        "0.5*m*(1 + (2*c*s)^2)*s_dot^2 + 0.5*(2 + tanh(s*u) + exp(-u^2))*u_dot^2 + 0.1*s_dot*u_dot*atan2(u, 2 + s)",
        "m*g*c*s^2 + sqrt(1 + s^2) + ln(2 + u) + abs(s - 0.2) + min(s, u)^2 + max(s, 2*u) + pow(2 + s, 1 + u/5) + pow(3 + u, 2.5) \
         + asin(s/4)*acos(u/4) + atan(s) + tan(u/4) + sinh(s/3)*cosh(u) + sign(u - 0.3) + s/(1 + u^2)",
        &[("m", 0.1), ("c", 2.0), ("g", 9.81)],
    )
}

/// A relativistic particle in a plane with a field across it, in units with c = 3: T is not quadratic in v.
fn relativistic_particle() -> TextLagrangian {
    text(
        &["x", "y"],
        "-m*c^2*sqrt(1 - (x_dot^2 + y_dot^2)/c^2) + 0.5*B*(x*y_dot - y*x_dot)",
        "k*(x^2 + y^2)/2",
        &[("m", 1.5), ("c", 3.0), ("B", 0.4), ("k", 2.0)],
    )
}

const ELBOW: &str = r#"<robot name="elbow">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.02 0 -0.2" rpy="0 0 0.3"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0.002" izz="0.01"/></inertial></link>
  <joint name="shoulder-pan" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <origin rpy="1.5707963267948966 0 0" xyz="0 0 1"/></joint>
  <link name="fore"><inertial><origin xyz="0 0 -0.15"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.002"/></inertial></link>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 -0.4"/></joint>
  <link name="tip"><inertial><origin xyz="0 0.01 0"/><mass value="0.3"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="fore"/><child link="tip"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 -0.3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"#;

/// `n` numbers in (−1, 1), the same for the same seed.
fn random(seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    };
    next();
    (0..n).map(|_| next()).collect()
}

/// A state and what `Dynamics` says there: M, C (empty where there is none), G, C v + G, [T, V], each row by row.
struct Expected {
    q: Vec<f64>,
    v: Vec<f64>,
    parts: [Vec<f64>; 5],
}

struct Case {
    name: &'static str,
    formulas: Formulas,
    /// The constants that have kept their names.
    p: Vec<f64>,
    expected: Vec<Expected>,
}

impl Case {
    fn new<L: Lagrangian + Clone>(
        name: &'static str,
        lagrangian: &L,
        coordinates: &[Coordinate],
        named: bool,
        states: usize,
    ) -> Case {
        let nominal: Vec<f64> = lagrangian.parameters().iter().map(|p| p.nominal).collect();
        // Other constants than the nominal ones, so that a name that became a number is seen.
        let p: Vec<f64> = nominal
            .iter()
            .enumerate()
            .map(|(i, p)| p * (1.0 + 0.03 * (i + 1) as f64))
            .collect();
        let bound: Vec<Option<f64>> = p.iter().map(|&p| (!named).then_some(p)).collect();
        let formulas = Formulas::of(lagrangian, coordinates, &bound).unwrap();
        let dynamics = Dynamics::new(lagrangian.clone(), coordinates.to_vec()).unwrap();
        let expected = (0..states as u64)
            .map(|k| expect(&dynamics, &p, k))
            .collect();
        Case {
            name,
            formulas,
            p: if named { p } else { Vec::new() },
            expected,
        }
    }
}

fn expect<L: Lagrangian>(dynamics: &Dynamics<L>, p: &[f64], seed: u64) -> Expected {
    let n = dynamics.nv();
    let mut q = random(seed, dynamics.nq());
    for (first, _) in dynamics
        .coordinates()
        .iter()
        .enumerate()
        .filter(|(_, c)| c.floating)
    {
        let norm = q[first + 3..first + 7]
            .iter()
            .map(|x| x * x)
            .sum::<f64>()
            .sqrt();
        q[first + 3..first + 7].iter_mut().for_each(|x| *x /= norm);
    }
    let v = random(seed + 1000, n);
    let mut work = dynamics.workspace();
    let mut mass = nalgebra::DMatrix::zeros(n, n);
    let mut coriolis = nalgebra::DMatrix::zeros(n, n);
    let mut gravity = nalgebra::DVector::zeros(n);
    let mut bias = nalgebra::DVector::zeros(n);
    dynamics.mass_matrix_into(&q, p, &mut work, &mut mass);
    dynamics.coriolis_matrix_into(&q, &v, p, &mut work, &mut coriolis);
    dynamics.gravity_force_into(&q, p, &mut work, &mut gravity);
    dynamics.bias_force_into(&q, &v, p, &mut work, &mut bias);
    let energies = vec![
        dynamics.kinetic_energy_with(&q, &v, p),
        dynamics.potential_energy_with(&q, p),
    ];
    let mut coriolis = coriolis.transpose().as_slice().to_vec();
    if !dynamics.kinetic_is_quadratic() {
        coriolis.clear();
        mass = reference::equations_with(dynamics.lagrangian(), &q, &v, p).mass_matrix;
    }
    let mass = mass.transpose().as_slice().to_vec();
    Expected {
        q,
        v,
        parts: [
            mass,
            coriolis,
            gravity.as_slice().to_vec(),
            bias.as_slice().to_vec(),
            energies,
        ],
    }
}

/// 1e-12 of the largest entry of the same matrix or vector.
fn assert_equal(name: &str, found: &[Vec<f64>], expected: &Expected) {
    assert_eq!(found.len(), expected.parts.len());
    for (k, (found, expected)) in found.iter().zip(&expected.parts).enumerate() {
        assert_eq!(found.len(), expected.len(), "{name}: part {k}");
        let scale = expected.iter().fold(1e-3, |m: f64, x| m.max(x.abs()));
        for (i, (f, e)) in found.iter().zip(expected).enumerate() {
            assert!(
                (f - e).abs() <= 1e-12 * scale,
                "{name}: part {k}, entry {i}: {f:e} for {e:e}"
            );
        }
    }
}

/// The numbers that the written formulas are, by the parser of the crate.
fn parsed(written: &Written, parameters: &[f64], at: &Expected) -> Vec<Vec<f64>> {
    let mut names: Vec<&str> = written
        .coordinates
        .iter()
        .chain(&written.velocities)
        .map(String::as_str)
        .collect();
    let mut values = [at.q.clone(), at.v.clone()].concat();
    names.extend(written.parameters.iter().map(String::as_str));
    values.extend(parameters);
    values.resize(names.len(), f64::NAN);
    let value = |formula: &str, names: &[&str], values: &[f64]| {
        let parsed =
            Expression::parse(formula, names).unwrap_or_else(|e| panic!("{formula}: {e:?}"));
        parsed.evaluate(|slot| values[slot])
    };
    for (name, formula) in &written.definitions {
        let x = value(formula, &names, &values);
        names.push(name);
        values.push(x);
    }
    let all = |formulas: &[String]| -> Vec<f64> {
        formulas.iter().map(|f| value(f, &names, &values)).collect()
    };
    vec![
        all(&written.mass_matrix.concat()),
        all(&written.coriolis_matrix.clone().unwrap_or_default().concat()),
        all(&written.gravity_force),
        all(&written.bias_force),
        all(&[
            written.kinetic_energy.clone(),
            written.potential_energy.clone(),
        ]),
    ]
}

fn cases() -> Vec<Case> {
    let elbow = urdf::read(ELBOW, &urdf::Options::default()).unwrap().tree;
    let on_elbow = |name, named| Case::new(name, &elbow, elbow.coordinates(), named, 10);
    let of = |name, l: &TextLagrangian, named| Case::new(name, l, l.coordinates(), named, 10);
    let mut cases = vec![
        of("cart_pole", &cart_pole(), true),
        of("cart_pole_numbers", &cart_pole(), false),
        of("double_pendulum", &double_pendulum(), true),
        of("furuta_pendulum", &furuta_pendulum(), true),
        of("every_function", &every_function(), true),
        of("relativistic_particle", &relativistic_particle(), true),
        on_elbow("elbow", false),
        on_elbow("elbow_mass_scales", true),
    ];
    if let Some(tree) = oracle("kuka_iiwa") {
        cases.push(Case::new("iiwa", &tree, tree.coordinates(), false, 3));
    }
    cases
}

fn oracle(name: &str) -> Option<lagrange::mechanism::Tree> {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../../shared/oracles/{name}.urdf"));
    let Ok(text) = std::fs::read_to_string(&path) else {
        eprintln!("SKIPPED {name}: no {}", path.display());
        return None;
    };
    Some(urdf::read(&text, &urdf::Options::default()).unwrap().tree)
}

#[test]
fn formulas_as_text_are_the_equations() {
    for case in cases() {
        let written = case.formulas.written(Style::Text);
        for at in &case.expected {
            assert_equal(case.name, &parsed(&written, &case.p, at), at);
        }
    }
}

/// Prints all numbers of a state in one line, in the order of `Expected::parts`.
const C_MAIN: &str = r#"
#include <stdio.h>
static void row(const double *x, int n) { for (int i = 0; i < n; i++) printf("%.17g ", x[i]); }
"#;

fn numbers(line: &str, parts: &[Vec<f64>; 5]) -> Vec<Vec<f64>> {
    let mut all = line.split_whitespace().map(|x| x.parse::<f64>().unwrap());
    parts
        .iter()
        .map(|part| all.by_ref().take(part.len()).collect())
        .collect()
}

fn list(x: &[f64]) -> String {
    let x: Vec<String> = x.iter().map(|x| format!("{x:?}")).collect();
    x.join(", ")
}

/// Runs a program that prints one line a state, over all cases.
fn assert_prints(program: &Path, cases: &[Case]) {
    let output = Command::new(program).output().unwrap();
    assert!(output.status.success());
    let output = String::from_utf8(output.stdout).unwrap();
    let mut lines = output.lines();
    for case in cases {
        for at in &case.expected {
            assert_equal(case.name, &numbers(lines.next().unwrap(), &at.parts), at);
        }
    }
    assert_eq!(lines.next(), None);
}

fn compiled(compiler: &mut Command) {
    let output = compiler.output().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && messages.is_empty(), "{messages}");
}

#[test]
fn emitted_c_compiles_without_warnings_and_gives_the_equations() {
    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("SKIPPED: there is no C compiler `cc`");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let cases = cases();
    let (mut source, mut main) = (String::from(C_MAIN), String::from("int main(void) {\n"));
    for case in &cases {
        source += &case.formulas.emit_c(case.name);
        for at in &case.expected {
            let [n, name] = [at.v.len().to_string(), case.name.to_owned()];
            let constants = if case.p.is_empty() {
                String::new()
            } else {
                format!("(double[]){{{}}}, ", list(&case.p))
            };
            let (c, print_c) = match at.parts[1].is_empty() {
                true => ("", String::new()),
                false => ("C, ", format!("row(&C[0][0], {n} * {n}); ")),
            };
            main += &format!(
                "{{ double M[{n}][{n}], C[{n}][{n}], G[{n}], b[{n}], e[2]; (void)C;\n{name}((double[]){{{}}}, (double[]){{{}}}, {constants}M, \
                 {c}G, b, e);\nrow(&M[0][0], {n} * {n}); {print_c}row(G, {n}); row(b, {n}); row(e, 2); puts(\"\"); }}\n",
                list(&at.q),
                list(&at.v),
            );
        }
    }
    source += &main;
    source += "return 0; }\n";
    let (file, program) = (folder.path().join("all.c"), folder.path().join("all"));
    std::fs::write(&file, source).unwrap();
    let flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-pedantic",
        "-Werror",
        "-O1",
        "-ffp-contract=off",
    ];
    compiled(
        Command::new("cc")
            .args(flags)
            .arg(&file)
            .arg("-o")
            .arg(&program)
            .arg("-lm"),
    );
    assert_prints(&program, &cases);
}

#[test]
fn emitted_rust_compiles_without_warnings_and_gives_the_equations() {
    let folder = tempfile::tempdir().unwrap();
    let cases = cases();
    let mut main = String::from(
        "fn row(x: &[f64]) {\n    x.iter().for_each(|x| print!(\"{x:e} \"));\n}\n\nfn main() {\n",
    );
    let mut modules = String::new();
    for case in &cases {
        let name = case.name;
        let emitted = case.formulas.emit_rust(name);
        let file = folder.path().join(format!("{name}.rs"));
        std::fs::write(&file, emitted).unwrap();
        let rustfmt = Command::new("rustfmt")
            .args(["--edition", "2021", "--check"])
            .arg(&file)
            .output();
        match rustfmt {
            Ok(output) => assert!(
                output.status.success(),
                "{}",
                String::from_utf8_lossy(&output.stdout)
            ),
            Err(_) => eprintln!("SKIPPED the format: there is no `rustfmt`"),
        }
        modules += &format!("mod {name};\n");
        for at in &case.expected {
            let p = if case.p.is_empty() {
                String::new()
            } else {
                format!(", &[{}]", list(&case.p))
            };
            let c = if at.parts[1].is_empty() {
                ""
            } else {
                "row(e.coriolis_matrix.as_flattened());"
            };
            main += &format!(
                "let e = {name}::{name}(&[{}], &[{}]{p}); row(e.mass_matrix.as_flattened()); {c} row(&e.gravity_force); \
                 row(&e.bias_force); row(&[e.kinetic_energy, e.potential_energy]); println!();\n",
                list(&at.q),
                list(&at.v),
            );
        }
    }
    main += "}\n";
    let (file, program) = (folder.path().join("main.rs"), folder.path().join("main"));
    std::fs::write(&file, modules + &main).unwrap();
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    compiled(
        Command::new(rustc)
            .args(["--edition", "2021", "-D", "warnings", "-o"])
            .arg(&program)
            .arg(&file),
    );
    assert_prints(&program, &cases);
    let mut clippy = Command::new("clippy-driver");
    clippy.args([
        "--edition",
        "2021",
        "-D",
        "warnings",
        "--crate-type",
        "bin",
        "--emit",
        "metadata",
        "-o",
    ]);
    if Command::new("clippy-driver")
        .arg("--version")
        .output()
        .is_ok()
    {
        compiled(clippy.arg(folder.path().join("out")).arg(&file));
    } else {
        eprintln!("SKIPPED the lints: there is no `clippy-driver`");
    }
}

/// C's `fmin` and Rust's `f64::min` return the other number where one is none.
#[test]
fn emitted_code_lets_no_nan_pass() {
    let model = text(
        &["x", "y"],
        "0.5*(x_dot^2 + y_dot^2)",
        "min(x, y) + 10*max(2*x, 0.5)",
        &[],
    );
    let formulas = Formulas::of(&model, model.coordinates(), &[]).unwrap();
    let states = [(1.0, 2.0), (f64::NAN, 2.0), (1.0, f64::NAN), (2.0, 1.0)];
    let expected: Vec<f64> = states.map(|(x, y)| model.potential(&[x, y])).to_vec();
    assert!(expected[1].is_nan() && expected[2].is_nan());
    assert_eq!((expected[0], expected[3]), (21.0, 41.0));
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("program");
    let assert_same = || {
        let output = Command::new(&program).output().unwrap();
        let output = String::from_utf8(output.stdout).unwrap().to_lowercase();
        for (line, expected) in output.lines().zip(&expected) {
            let found: f64 = line.parse().unwrap();
            assert!(
                found == *expected || (found.is_nan() && expected.is_nan()),
                "{found} for {expected}"
            );
        }
        assert_eq!(output.lines().count(), expected.len());
    };

    let call = |(x, y): (f64, f64)| format!("V({x:?}, {y:?});\n");
    let calls: String = states.map(call).concat();
    let rust = formulas.emit_rust("model")
        + "#[allow(non_snake_case)]\nfn V(x: f64, y: f64) {\n    println!(\"{:?}\", model(&[x, y], &[0.0; 2]).potential_energy);\n}\n"
        + &format!("fn main() {{\n{}}}\n", calls.replace("NaN", "f64::NAN"));
    let file = folder.path().join("main.rs");
    std::fs::write(&file, rust).unwrap();
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    // Fields that are not read here are no fault.
    let flags = ["--edition", "2021", "-A", "dead_code", "-o"];
    compiled(Command::new(rustc).args(flags).arg(&program).arg(&file));
    assert_same();

    if Command::new("cc").arg("--version").output().is_err() {
        eprintln!("SKIPPED: there is no C compiler `cc`");
        return;
    }
    let c = formulas.emit_c("model")
        + "#include <stdio.h>\nstatic void V(double x, double y) {\n    double M[2][2], C[2][2], G[2], b[2], e[2];\n    \
           model((double[]){x, y}, (double[]){0.0, 0.0}, M, C, G, b, e);\n    printf(isnan(e[1]) ? \"nan\\n\" : \"%.17g\\n\", e[1]);\n}\n"
        + &format!(
            "int main(void) {{\n{}return 0; }}\n",
            calls.replace("NaN", "NAN")
        );
    let file = folder.path().join("main.c");
    std::fs::write(&file, c).unwrap();
    let flags = ["-std=c99", "-O1", "-o"];
    compiled(
        Command::new("cc")
            .args(flags)
            .arg(&program)
            .arg(&file)
            .arg("-lm"),
    );
    assert_same();
}

#[test]
fn a_cart_pole_reads_like_a_textbook() {
    let model = cart_pole();
    let formulas = Formulas::of(&model, model.coordinates(), &[None; 4]).unwrap();
    let expected = "\
M(q) v̇ + C(q, v) v + G(q) = Q

q = [x, phi]
v = [x_dot, phi_dot]
constants: mc = 0.47, m = 0.06, l = 0.17, g = 9.81

M = [[mc + m,       m*l*cos(phi)],
     [m*l*cos(phi), m*l^2]]

C = [[0, -m*l*sin(phi)*phi_dot],
     [0, 0]]

G = [0, -m*l*g*sin(phi)]

T = 0.5*(mc + m)*x_dot^2 + 0.5*m*l^2*phi_dot^2 + m*l*cos(phi)*x_dot*phi_dot
V = m*l*g*cos(phi)
";
    assert_eq!(formulas.to_text(), expected);
    let latex = formulas.to_latex();
    assert!(
        latex.contains(r"\mathrm{mc} + m & m \, l \, \cos \phi \\"),
        "{latex}"
    );
    assert!(
        latex.contains(r"-m \, l \, \sin \phi \, \dot{\phi}"),
        "{latex}"
    );
}

#[test]
fn equal_terms_are_collected_and_angles_added() {
    let model = double_pendulum();
    let written = Formulas::of(&model, model.coordinates(), &[None; 5])
        .unwrap()
        .written(Style::Text);
    assert!(written.definitions.is_empty());
    assert_eq!(
        written.mass_matrix[0],
        ["(m1 + m2)*l1^2", "m2*l1*l2*cos(theta1 - theta2)"]
    );
    assert_eq!(
        written.coriolis_matrix.unwrap(),
        [
            ["0", "m2*l1*l2*sin(theta1 - theta2)*theta2_dot"],
            ["-m2*l1*l2*sin(theta1 - theta2)*theta1_dot", "0"]
        ]
    );
    assert_eq!(
        written.gravity_force,
        ["(m1 + m2)*l1*g*sin(theta1)", "m2*l2*g*sin(theta2)"]
    );
}

/// A frame turned by π/2 has cos(π/2) = 6e-17 in it; products of numbers miss their decimals by a unit in the last place.
#[test]
fn rounding_is_not_printed() {
    let tree = urdf::read(ELBOW, &urdf::Options::default()).unwrap().tree;
    let written = Formulas::of(&tree, tree.coordinates(), &[Some(1.0); 3])
        .unwrap()
        .written(Style::Text);
    let all = [
        written.mass_matrix.concat(),
        written.coriolis_matrix.unwrap().concat(),
        written.gravity_force,
    ];
    for formula in all.concat() {
        assert!(!formula.contains("e-"), "{formula}");
        assert!(!formula.contains("00000000"), "{formula}");
    }
}

/// The numbers of a formula that are no exponents.
fn constants(formula: &str) -> Vec<f64> {
    let exponent = |text: &str| text.ends_with('^');
    let mut found = Vec::new();
    let mut rest = formula;
    let mut before = String::new();
    while let Some(c) = rest.chars().next() {
        let number: String = rest
            .char_indices()
            .take_while(|&(i, c)| {
                let sign = i > 0 && "+-".contains(c) && rest[..i].ends_with('e');
                c.is_ascii_digit() || c == '.' || (i > 0 && c == 'e') || sign
            })
            .map(|(_, c)| c)
            .collect();
        let in_name = before.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        if number.is_empty() || in_name {
            before.push(c);
            rest = &rest[c.len_utf8()..];
            continue;
        }
        if !exponent(&before) {
            found.push(number.parse().unwrap());
        }
        before += &number;
        rest = &rest[number.len()..];
    }
    found
}

/// The smallest number other than 0 over the largest of some formulas.
fn spread<'a>(formulas: impl IntoIterator<Item = &'a String>) -> f64 {
    let all = formulas.into_iter().flat_map(|f| constants(f));
    let all: Vec<f64> = all.filter(|x| *x != 0.0).collect();
    let largest = all.iter().fold(0.0_f64, |m, x| m.max(*x));
    all.iter().fold(1.0, |m, x| m.min(x / largest))
}

#[test]
fn the_numbers_of_a_formula_are_read_as_they_stand() {
    let found = constants("2.5e-3*t12^2 - 7*(q1 + 1e-16*x_2)/(3*sin(0.5 - 4*a))^10");
    assert_eq!(found, [2.5e-3, 7.0, 1e-16, 3.0, 0.5, 4.0]);
}

/// Hand over hand turned by π, legs at thirds of a circle, an arm of seven joints: in the formulas of the first two stood 1e-17 beside
/// 1, and whole entries of 1e-20.
#[test]
fn formulas_of_larger_models_have_no_numbers_of_rounding() {
    for (model, floating) in [
        ("gripper", false),
        ("stewart", false),
        ("arm7", false),
        ("quadruped", false),
        ("quadruped", true),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../models/{model}/{model}.urdf"));
        let options = urdf::Options {
            floating_base: floating,
            ..urdf::Options::default()
        };
        let tree = urdf::read(&std::fs::read_to_string(path).unwrap(), &options)
            .unwrap()
            .tree;
        let bound: Vec<Option<f64>> = tree.parameters().iter().map(|p| Some(p.nominal)).collect();
        let written = Formulas::of(&tree, tree.coordinates(), &bound)
            .unwrap()
            .written(Style::Text);
        let parts = [
            written.mass_matrix.concat(),
            written.coriolis_matrix.unwrap().concat(),
            written.gravity_force,
            written.bias_force,
            vec![written.kinetic_energy],
            vec![written.potential_energy],
        ];
        for part in &parts {
            let spread = spread(part);
            assert!(spread >= 1e-12, "{model}: {spread:e} in {part:#?}");
        }
        for (name, formula) in &written.definitions {
            let spread = spread([formula]);
            assert!(spread >= 1e-12, "{model}: {name} = {formula}");
        }
    }
}

/// Without velocities in M there is no C to write.
#[test]
fn a_mass_that_grows_with_velocity_is_written_with_its_bias() {
    let model = relativistic_particle();
    let formulas = Formulas::of(&model, model.coordinates(), &[None; 4]).unwrap();
    assert!(!formulas.kinetic_is_quadratic());
    let written = formulas.written(Style::Text);
    assert!(written.coriolis_matrix.is_none());
    assert_eq!(written.bias_force, ["k*x - B*y_dot", "k*y + B*x_dot"]);
    assert!(
        formulas
            .to_text()
            .contains("T is not quadratic in the velocities")
    );
}

#[derive(Clone)]
struct Branching;

impl Lagrangian for Branching {
    fn dof(&self) -> usize {
        1
    }
    fn kinetic<D: Scalar>(&self, _q: &[D], v: &[D]) -> D {
        v[0] * v[0]
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        if q[0].re() > 0.0 { q[0] } else { q[0] * 2.0 }
    }
}

#[test]
fn energies_that_choose_by_values_have_no_formula() {
    let coordinates = Dynamics::of(Branching).coordinates().to_vec();
    let error = Formulas::of(&Branching, &coordinates, &[]).unwrap_err();
    assert_eq!(error, FormulasError::Branches);
    assert!(error.to_string().contains("`min` or `max`"));
    let error = Formulas::of(&Branching, &[], &[]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "coordinates has 0 entries, this mechanism takes 1"
    );
}
