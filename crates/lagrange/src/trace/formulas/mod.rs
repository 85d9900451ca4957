//! The equations of motion as formulas to read, and as functions in Rust and C.

mod block;
mod emit;
mod form;
mod latex;
mod layout;
mod names;
mod page;
mod polynomial;
mod simplify;
mod write;

pub use page::{Style, Written};

use block::{Block, Cut};
use layout::{Layout, Sizes};
use names::Names;
use polynomial::{Algebra, Polynomial};

use super::derivative::{TooLarge, along, derivative, gradient};
use super::graph::{Graph, Id};
use super::traced::{Traced, go_on, variable};
use crate::dynamics::is_quadratic;
use crate::mechanism::Tree;
use crate::{Coordinate, Lagrangian, Parameter, Scalar, tree};

/// A graph larger than this is given up.
const MOST_NODES: usize = 400_000;
/// A polynomial that grows beyond so many terms on the way is given up.
const MOST_TERMS: usize = 600;
/// Most terms of all formulas together that are written term by term; longer ones are written with named subexpressions.
const MOST_WRITTEN: usize = 250;

/// More coordinates than these are not tried to be written term by term.
const MOST_EXPANDED: usize = 6;

/// Why there are no formulas.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FormulasError {
    /// The energies ask for the value of a number and choose by it.
    #[error(
        "the energies branch on values (they call `Scalar::re`), so that one formula does not hold for all states: write the choice \
         with `abs`, `sign`, `min` or `max`"
    )]
    Branches,
    /// The equations have too many terms.
    #[error(
        "the equations take more than {limit} operations: there are no formulas of this size; use the numbers of `Dynamics`"
    )]
    TooLarge {
        /// Most operations.
        limit: usize,
    },
    /// A list has the wrong length.
    #[error("{what} has {found} entries, this mechanism takes {expected}")]
    Dimension {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// The mechanism has no energies that could be written down.
    #[error("this mechanism is not given by energies: there is nothing to write down")]
    NoEnergies,
}

impl From<TooLarge> for FormulasError {
    fn from(_: TooLarge) -> Self {
        FormulasError::TooLarge { limit: MOST_NODES }
    }
}

/// M, C and G of one mechanism as formulas in its coordinates, velocities and constants.
///
/// - M(q) v̇ + C(q, v) v + G(q) = Q, with Christoffel's C and G = +∂V/∂q on the left-hand side.
/// - For T that is not quadratic in v there is no C: M(q, v) = ∂²T/∂v∂v, and the bias force (∂²T/∂v∂q) v − ∂T/∂q + G stands for C v + G.
///
/// Formulas of small mechanisms are sums of products, with equal terms collected and sin² + cos² = 1 used; those of large mechanisms
/// have names for what they share. Terms of the size of rounding are left out (ε = 2.2·10⁻¹⁶): of a sum of products, those of at most
/// 4 ε of another one with the same velocities and constants; of the equations of a tree of rigid bodies, those of constants, sines
/// and cosines alone that are at most 8 ε of what another such term of the same sum can be. Numbers are shortened by no more than
/// 4 ε. All is equal to the numbers of [`Dynamics`](crate::Dynamics) but for rounding.
///
/// ```
/// use lagrange::{Formulas, Lagrangian, Style, TextLagrangian, TextSource};
///
/// let cart_pole = TextLagrangian::new(&TextSource {
///     coordinates: vec!["x".into(), "phi".into()],
///     angles: vec!["phi".into()],
///     kinetic: "0.5*mc*x_dot^2 + 0.5*m*((x_dot + l*cos(phi)*phi_dot)^2 + (l*sin(phi)*phi_dot)^2)".into(),
///     potential: "m*g*l*cos(phi)".into(),
///     parameters: [("mc", 1.0), ("m", 0.1), ("l", 0.5), ("g", 9.81)].map(|(name, x)| (name.into(), x)).to_vec(),
///     ..TextSource::default()
/// })
/// .map_err(|problems| problems[0].clone())?;
/// let formulas = Formulas::of(&cart_pole, cart_pole.coordinates(), &[None; 4])?;
/// let written = formulas.written(Style::Text);
/// assert_eq!(written.mass_matrix[0], ["mc + m", "m*l*cos(phi)"]);
/// assert_eq!(written.mass_matrix[1], ["m*l*cos(phi)", "m*l^2"]);
/// assert_eq!(written.coriolis_matrix.unwrap_or_default()[0], ["0", "-m*l*sin(phi)*phi_dot"]);
/// assert_eq!(written.gravity_force, ["0", "-m*l*g*sin(phi)"]);
/// assert_eq!(formulas.written(Style::Latex).gravity_force[1], r"-m \, l \, g \, \sin \phi");
///
/// // With the constants as numbers:
/// let numbers = Formulas::of(&cart_pole, cart_pole.coordinates(), &[1.0, 0.1, 0.5, 10.0].map(Some))?;
/// assert_eq!(numbers.written(Style::Text).gravity_force[1], "-0.5*sin(phi)");
/// println!("{}", formulas.to_text());
/// println!("{}", formulas.emit_c("cart_pole"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Formulas {
    parameters: Vec<Parameter>,
    /// Numbers in place of constants.
    bound: Vec<Option<f64>>,
    names: Names,
    sizes: Sizes,
    quadratic: bool,
    /// Equations φ = 0 that the mechanism obeys beside these.
    constraints: Vec<String>,
    /// What is written for people.
    readable: Block,
    /// What is written for compilers: short statements, every value computed once.
    code: Block,
    nodes: usize,
}

/// The nodes of a graph that the equations are.
struct Roots {
    mass: Vec<Id>,
    /// None unless T is quadratic in v.
    coriolis: Option<Vec<Id>>,
    gravity: Vec<Id>,
    bias: Vec<Id>,
    kinetic: Id,
    potential: Id,
}

impl Roots {
    fn all(&self) -> Vec<Id> {
        let coriolis = self.coriolis.as_deref().unwrap_or(&[]);
        let energies = [self.kinetic, self.potential];
        [&self.mass, coriolis, &self.gravity, &self.bias, &energies].concat()
    }
}

impl Formulas {
    /// The equations of `lagrangian`, with the names of `coordinates`; constants for which `bound` has a number are that number, the
    /// others keep their names.
    ///
    /// # Errors
    /// [`FormulasError::Branches`] when the energies choose by values, [`FormulasError::TooLarge`], and
    /// [`FormulasError::Dimension`] when a list has the wrong length.
    pub fn of<L: Lagrangian>(
        lagrangian: &L,
        coordinates: &[Coordinate],
        bound: &[Option<f64>],
    ) -> Result<Self, FormulasError> {
        let parameters = lagrangian.parameters();
        let sizes = Sizes {
            nq: coordinates.iter().map(Coordinate::nq).sum(),
            nv: coordinates.iter().map(Coordinate::nv).sum(),
        };
        let expect = |what, found, expected| match found == expected {
            true => Ok(()),
            false => Err(FormulasError::Dimension {
                what,
                found,
                expected,
            }),
        };
        expect("coordinates", sizes.nv, lagrangian.dof())?;
        expect("bound constants", bound.len(), parameters.len())?;

        let quadratic = lagrangian.rigid_bodies().is_some() || is_quadratic(lagrangian);
        let traced = |graph: Graph| traced(graph, lagrangian, sizes, bound);
        let energies = traced(Graph::default())?;
        let variables = sizes.nq + sizes.nv + parameters.len();
        let (graph, roots) = match lagrangian.rigid_bodies() {
            Some(tree) => {
                // Nothing of this is differentiated.
                let energies = traced(Graph::default().without_rounding())?;
                joint_by_joint(tree, energies, sizes, bound)
            }
            None => differentiated(energies.clone(), sizes.nv, quadratic)?,
        };
        let outputs = roots.all();
        let code = Block::of_graph(
            &graph,
            &outputs,
            sizes,
            Cut {
                width: 60,
                calls_on_names: true,
            },
        );
        // T and V hold less rounding than sums over joints.
        let by_energies = if sizes.nq == sizes.nv && sizes.nv <= MOST_EXPANDED {
            differentiated(energies, sizes.nv, quadratic).ok()
        } else {
            None
        };
        let short =
            by_energies.and_then(|(graph, roots)| expanded(&graph, &roots.all(), sizes, variables));
        let readable = short.unwrap_or_else(|| {
            let cut = Cut {
                width: 90,
                calls_on_names: false,
            };
            Block::of_graph(&graph, &outputs, sizes, cut)
        });
        Ok(Formulas {
            parameters: parameters.to_vec(),
            bound: bound.to_vec(),
            names: Names::of(coordinates, parameters),
            sizes,
            quadratic,
            constraints: Vec::new(),
            readable,
            code,
            nodes: graph.needed(&outputs),
        })
    }

    /// The same, saying that the mechanism obeys constraints of these names.
    pub(crate) fn under(mut self, constraints: &[String]) -> Self {
        self.constraints = constraints.to_vec();
        self
    }

    /// Whether T is quadratic in v, so that there is a C.
    pub fn kinetic_is_quadratic(&self) -> bool {
        self.quadratic
    }

    /// How many operations, variables and numbers the equations are made of before they are written down.
    pub fn nodes(&self) -> usize {
        self.nodes
    }
}

/// The formulas as sums of products, where they stay short.
fn expanded(graph: &Graph, outputs: &[Id], sizes: Sizes, variables: usize) -> Option<Block> {
    let mut algebra = Algebra::new(variables, MOST_TERMS);
    let sums = algebra.expand(graph, outputs).ok()?;
    let simplest = |sum: &Polynomial| simplify::simplest(&mut algebra, sum);
    let sums: Vec<Polynomial> = sums.iter().map(simplest).collect();
    if sums.iter().map(|sum| sum.0.len()).sum::<usize>() > MOST_WRITTEN {
        return None;
    }
    let layout = Layout {
        algebra: &algebra,
        sizes,
    };
    let mut block = Block {
        definitions: Vec::new(),
        outputs: sums.iter().map(|sum| layout.form(sum)).collect(),
    };
    block.share(3, 40);
    Some(block)
}

/// T and V, written down.
#[derive(Clone)]
struct Energies {
    graph: Graph,
    kinetic: Id,
    potential: Id,
}

/// The variables q and v, and the constants, as names or numbers.
fn arguments(sizes: Sizes, bound: &[Option<f64>]) -> [Vec<Traced>; 3] {
    let Sizes { nq, nv } = sizes;
    let range = |from: usize, n: usize| -> Vec<Traced> { (from..from + n).map(variable).collect() };
    let (q, v, mut p) = (range(0, nq), range(nq, nv), range(nq + nv, bound.len()));
    for (p, bound) in p.iter_mut().zip(bound) {
        if let Some(number) = bound {
            *p = Traced::constant(*number);
        }
    }
    [q, v, p]
}

/// T and V, added to `graph`.
fn traced<L: Lagrangian>(
    mut graph: Graph,
    lagrangian: &L,
    sizes: Sizes,
    bound: &[Option<f64>],
) -> Result<Energies, FormulasError> {
    let (kinetic, potential) = go_on(&mut graph, || {
        let [q, v, p] = arguments(sizes, bound);
        let kinetic = lagrangian.kinetic_with(&q, &v, &p);
        (kinetic.0, lagrangian.potential_with(&q, &p).0)
    });
    if graph.branched {
        return Err(FormulasError::Branches);
    }
    Ok(Energies {
        graph,
        kinetic,
        potential,
    })
}

/// The equations of a tree of rigid bodies from sums over its joints: few operations.
fn joint_by_joint(
    tree: &Tree,
    energies: Energies,
    sizes: Sizes,
    bound: &[Option<f64>],
) -> (Graph, Roots) {
    let Energies {
        mut graph,
        kinetic,
        potential,
    } = energies;
    let ids = |traced: Vec<Traced>| -> Vec<Id> { traced.into_iter().map(|t| t.0).collect() };
    let equations = go_on(&mut graph, || {
        let [q, v, p] = arguments(sizes, bound);
        tree::equations(tree, &q, &v, &p)
    });
    let (mass, gravity) = (ids(equations.mass), ids(equations.gravity));
    let coriolis = ids(equations.coriolis);
    let bias = bias_of(&mut graph, &coriolis, &gravity, sizes);
    let roots = Roots {
        mass,
        coriolis: Some(coriolis),
        gravity,
        bias,
        kinetic,
        potential,
    };
    (graph, roots)
}

/// C v + G.
fn bias_of(graph: &mut Graph, coriolis: &[Id], gravity: &[Id], sizes: Sizes) -> Vec<Id> {
    let rows = coriolis.chunks(sizes.nv.max(1));
    let pairs: Vec<(&[Id], Id)> = rows.zip(gravity.iter().copied()).collect();
    go_on(graph, || {
        let row = |(row, gravity): &(&[Id], Id)| {
            let terms = row.iter().enumerate();
            let coriolis = terms.fold(Traced::zero(), |sum, (j, &c)| {
                sum + Traced(c) * variable(sizes.nq + j)
            });
            (coriolis + Traced(*gravity)).0
        };
        pairs.iter().map(row).collect()
    })
}

/// The equations from T and V by differentiation:
///
/// M = ∂²T/∂v∂v, bias = (∂²T/∂v∂q) v − ∂T/∂q + ∂V/∂q, C_ij = Σ_k ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) v_k.
fn differentiated(
    energies: Energies,
    n: usize,
    quadratic: bool,
) -> Result<(Graph, Roots), TooLarge> {
    let Energies {
        mut graph,
        kinetic,
        potential,
    } = energies;
    let g = &mut graph;
    let q: Vec<u32> = (0..n as u32).collect();
    let v: Vec<u32> = (n as u32..2 * n as u32).collect();
    let by_state = gradient(g, kinetic, &[q.clone(), v.clone()].concat(), MOST_NODES)?;
    let (by_q, momentum) = by_state.split_at(n);
    let gravity = gradient(g, potential, &q, MOST_NODES)?;

    let mut mass = vec![0; n * n];
    for (j, &velocity) in v.iter().enumerate() {
        // The lower half; M is symmetric.
        let rows = momentum.get(j..).unwrap_or(&[]);
        let column = derivative(g, rows, velocity, MOST_NODES)?;
        for (i, entry) in (j..n).zip(column) {
            mass[i * n + j] = entry;
            mass[j * n + i] = entry;
        }
    }
    let (coriolis, bias) = if quadratic {
        let mut by_q = Vec::with_capacity(n);
        for &coordinate in &q {
            by_q.push(derivative(g, &mass, coordinate, MOST_NODES)?);
        }
        let coriolis: Vec<Id> = go_on(g, || {
            let slope = |i: usize, j: usize, k: usize| Traced(by_q[k][i * n + j]);
            let entry = |i: usize, j: usize| {
                (0..n).fold(Traced::zero(), |sum, k| {
                    let twice = slope(i, j, k) + slope(i, k, j) - slope(j, k, i);
                    sum + twice * 0.5 * variable(n + k)
                })
            };
            let entries = (0..n * n).map(|at| entry(at / n, at % n).0);
            entries.collect()
        });
        let bias = bias_of(g, &coriolis, &gravity, Sizes { nq: n, nv: n });
        (Some(coriolis), bias)
    } else {
        // The momentum's rate while q moves with v and v stays.
        let direction: Vec<(u32, Id)> = q
            .iter()
            .zip(&v)
            .map(|(&q, &v)| (q, g.variable(v)))
            .collect();
        let rates = along(g, momentum, &direction, MOST_NODES)?;
        let bias = go_on(g, || {
            let terms = rates.iter().zip(by_q).zip(&gravity);
            terms
                .map(|((&r, &t), &g)| (Traced(r) - Traced(t) + Traced(g)).0)
                .collect()
        });
        (None, bias)
    };
    let roots = Roots {
        mass,
        coriolis,
        gravity,
        bias,
        kinetic,
        potential,
    };
    Ok((graph, roots))
}
