//! The problems.

use integrators::problems::{
    DoublePendulum, HeavyTop, Kepler, Pendulum, Problem as _, RigidBody, Robertson, VanDerPol,
};

use super::plain::plain;
use super::{Bench, Reference, evenly, in_decades};

/// All of them, in the order of the table.
pub(crate) fn all(bench: &mut Bench) {
    let pendulum = Pendulum {
        frequency: 3.0,
        amplitude: 2.6,
    };
    let fixed = Reference::Fixed(4000);
    bench.problem("pendulum, 149°", &pendulum, evenly(20.0), &[1.0; 2], fixed);
    let orbit = Kepler { eccentricity: 0.6 };
    bench.problem("Kepler, e = 0.6", &orbit, evenly(20.0), &[1.0; 4], fixed);
    let double = DoublePendulum::default();
    bench.problem(
        "double pendulum",
        &double,
        evenly(double.span()),
        &[1.0; 4],
        fixed,
    );
    let body = RigidBody {
        moments: [1.0, 2.0, 3.0],
        across: 1.0,
        along: 1.2,
    };
    bench.problem("free rigid body", &body, evenly(10.0), &[1.0; 6], fixed);
    let top = HeavyTop::default();
    bench.problem("heavy top", &top, evenly(top.span()), &[1.0; 6], fixed);
    let reaction = Robertson::default();
    let sizes = [1.0, 1e-4, 1.0];
    bench.problem(
        "Robertson, 40 s",
        &reaction,
        evenly(40.0),
        &sizes,
        Reference::Implicit,
    );
    let sizes = [1e-6, 1e-10, 1.0];
    bench.problem(
        "Robertson, 1e11 s",
        &reaction,
        in_decades(1.0, 1e11),
        &sizes,
        Reference::Implicit,
    );
    for (name, epsilon, end, reference) in [
        ("van der Pol, ε = 1e-6", 1e-6, 2.0, Reference::Implicit),
        ("van der Pol, ε = 1e-3", 1e-3, 2.0, Reference::Implicit),
        ("van der Pol, ε = 0.1", 0.1, 4.0, fixed),
    ] {
        bench.problem(
            name,
            &VanDerPol { epsilon },
            evenly(end),
            &[1.0; 2],
            reference,
        );
    }

    // Hairer and Wanner II, IV.10: the chemical reaction of eight species of Schäfer (1975).
    let hires = plain(
        8,
        |_t, y: &[f64], dy: &mut [f64]| {
            let r = 280.0 * y[5] * y[7];
            dy[0] = -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007;
            dy[1] = 1.71 * y[0] - 8.75 * y[1];
            dy[2] = -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4];
            dy[3] = 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3];
            dy[4] = -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6];
            dy[5] = -r + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6];
            dy[6] = r - 1.81 * y[6];
            dy[7] = -r + 1.81 * y[6];
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            for (i, j, value) in [
                (0, 0, -1.71),
                (0, 1, 0.43),
                (0, 2, 8.32),
                (1, 0, 1.71),
                (1, 1, -8.75),
                (2, 2, -10.03),
                (2, 3, 0.43),
                (2, 4, 0.035),
                (3, 1, 8.32),
                (3, 2, 1.71),
                (3, 3, -1.12),
                (4, 4, -1.745),
                (4, 5, 0.43),
                (4, 6, 0.43),
                (5, 3, 0.69),
                (5, 4, 1.71),
                (5, 5, -0.43 - 280.0 * y[7]),
                (5, 6, 0.69),
                (5, 7, -280.0 * y[5]),
                (6, 5, 280.0 * y[7]),
                (6, 6, -1.81),
                (6, 7, 280.0 * y[5]),
                (7, 5, -280.0 * y[7]),
                (7, 6, 1.81),
                (7, 7, -280.0 * y[5]),
            ] {
                set(i, j, value);
            }
        },
    );
    bench.plain(
        "HIRES",
        &hires,
        &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057],
        evenly(321.8122),
        &[1e-3; 8],
        Reference::Implicit,
    );
    // Hairer and Wanner II, IV.10: Field and Noyes.
    let oregonator = plain(
        3,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[0] = 77.27 * (y[1] + y[0] * (1.0 - 8.375e-6 * y[0] - y[1]));
            dy[1] = (y[2] - (1.0 + y[0]) * y[1]) / 77.27;
            dy[2] = 0.161 * (y[0] - y[2]);
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 0, 77.27 * (1.0 - 2.0 * 8.375e-6 * y[0] - y[1]));
            set(0, 1, 77.27 * (1.0 - y[0]));
            set(1, 0, -y[1] / 77.27);
            set(1, 1, -(1.0 + y[0]) / 77.27);
            set(1, 2, 1.0 / 77.27);
            set(2, 0, 0.161);
            set(2, 2, -0.161);
        },
    );
    bench.plain(
        "Oregonator",
        &oregonator,
        &[1.0, 2.0, 3.0],
        evenly(100.0),
        &[1.0; 3],
        Reference::Implicit,
    );
    // A stiff spring in a swinging one: r̈ = r θ̇² + g cos θ − k (r − 1) − d ṙ, r θ̈ = −g sin θ − 2 ṙ θ̇.
    let spring = plain(
        4,
        |_t, y: &[f64], dy: &mut [f64]| {
            let (r, theta, v, w) = (y[0], y[1], y[2], y[3]);
            dy[0] = v;
            dy[1] = w;
            dy[2] = r * w * w + 9.81 * theta.cos() - 1e5 * (r - 1.0) - 600.0 * v;
            dy[3] = (-9.81 * theta.sin() - 2.0 * v * w) / r;
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            let (r, theta, v, w) = (y[0], y[1], y[2], y[3]);
            set(0, 2, 1.0);
            set(1, 3, 1.0);
            set(2, 0, w * w - 1e5);
            set(2, 1, -9.81 * theta.sin());
            set(2, 2, -600.0);
            set(2, 3, 2.0 * r * w);
            set(3, 0, (9.81 * theta.sin() + 2.0 * v * w) / (r * r));
            set(3, 1, -9.81 * theta.cos() / r);
            set(3, 2, -2.0 * w / r);
            set(3, 3, -2.0 * v / r);
        },
    );
    bench.plain(
        "pendulum on a stiff damped spring",
        &spring,
        &[1.0, 1.5, 0.0, 0.0],
        evenly(5.0),
        &[1.0; 4],
        Reference::Implicit,
    );

    for epsilon in [1e-4, 1e-5] {
        let name = format!("van der Pol, ε = {epsilon:e}");
        let problem = VanDerPol { epsilon };
        bench.problem(&name, &problem, evenly(2.0), &[1.0; 2], Reference::Implicit);
    }
    // Prothero and Robinson: ẏ = −λ (y − cos t) − sin t with y = cos t; time is the second coordinate.
    let prothero = plain(
        2,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[0] = -1e4 * (y[0] - y[1].cos()) - y[1].sin();
            dy[1] = 1.0;
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 0, -1e4);
            set(0, 1, -1e4 * y[1].sin() - y[1].cos());
        },
    );
    bench.plain(
        "Prothero and Robinson",
        &prothero,
        &[1.0, 0.0],
        evenly(10.0),
        &[1.0; 2],
        Reference::Implicit,
    );
    // Hairer and Wanner II, IV.10, on a coarser grid: the Brusselator with diffusion on 16 points, α (N + 1)² = 5.78.
    const POINTS: usize = 16;
    let diffusion = 0.02 * ((POINTS + 1) * (POINTS + 1)) as f64;
    let brusselator = plain(
        2 * POINTS,
        move |_t, y: &[f64], dy: &mut [f64]| {
            for i in 0..POINTS {
                let (u, v) = (y[i], y[POINTS + i]);
                let side = |at: usize, edge: f64| -> f64 {
                    let left = if i == 0 { edge } else { y[at - 1] };
                    let right = if i + 1 == POINTS { edge } else { y[at + 1] };
                    diffusion * (left - 2.0 * y[at] + right)
                };
                dy[i] = 1.0 + u * u * v - 4.0 * u + side(i, 1.0);
                dy[POINTS + i] = 3.0 * u - u * u * v + side(POINTS + i, 3.0);
            }
        },
        move |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            for i in 0..POINTS {
                let (u, v) = (y[i], y[POINTS + i]);
                set(i, i, 2.0 * u * v - 4.0 - 2.0 * diffusion);
                set(i, POINTS + i, u * u);
                set(POINTS + i, i, 3.0 - 2.0 * u * v);
                set(POINTS + i, POINTS + i, -u * u - 2.0 * diffusion);
                for base in [0, POINTS] {
                    if i > 0 {
                        set(base + i, base + i - 1, diffusion);
                    }
                    if i + 1 < POINTS {
                        set(base + i, base + i + 1, diffusion);
                    }
                }
            }
        },
    );
    let start: Vec<f64> = (0..2 * POINTS)
        .map(|i| {
            let place = (i + 1) as f64 / (POINTS + 1) as f64;
            if i < POINTS {
                1.0 + (std::f64::consts::TAU * place).sin()
            } else {
                3.0
            }
        })
        .collect();
    bench.plain(
        "Brusselator, 16 points",
        &brusselator,
        &start,
        evenly(10.0),
        &[1.0; 2 * POINTS],
        Reference::Implicit,
    );

    // What follows was looked at for one failure or two of the changes, and is not what their constants were chosen for.

    // Hairer, Nørsett and Wanner I, II.0: a satellite between the Earth and the Moon, once around its closed orbit of Arenstorf.
    const MOON: f64 = 0.012277471;
    const EARTH: f64 = 1.0 - MOON;
    let three_bodies = plain(
        4,
        |_t, y: &[f64], dy: &mut [f64]| {
            let (a, b) = (y[0] + MOON, y[0] - EARTH);
            let earth = EARTH / a.hypot(y[1]).powi(3);
            let moon = MOON / b.hypot(y[1]).powi(3);
            dy[0] = y[2];
            dy[1] = y[3];
            dy[2] = y[0] + 2.0 * y[3] - earth * a - moon * b;
            dy[3] = y[1] - 2.0 * y[2] - (earth + moon) * y[1];
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            let (a, b) = (y[0] + MOON, y[0] - EARTH);
            let (to_earth, to_moon) = (a.hypot(y[1]), b.hypot(y[1]));
            let (earth, moon) = (EARTH / to_earth.powi(3), MOON / to_moon.powi(3));
            let (e, m) = (3.0 * earth / to_earth.powi(2), 3.0 * moon / to_moon.powi(2));
            let across = (e * a + m * b) * y[1];
            set(0, 2, 1.0);
            set(1, 3, 1.0);
            set(2, 0, 1.0 - earth - moon + e * a * a + m * b * b);
            set(2, 1, across);
            set(2, 3, 2.0);
            set(3, 0, across);
            set(3, 1, 1.0 - earth - moon + (e + m) * y[1] * y[1]);
            set(3, 2, -2.0);
        },
    );
    let start = [0.994, 0.0, 0.0, -2.001_585_106_379_082_5];
    bench.plain(
        "Arenstorf's orbit",
        &three_bodies,
        &start,
        evenly(17.065_216_560_157_96),
        &[1.0; 4],
        Reference::Fixed(40_000),
    );
    // Hairer, Nørsett and Wanner I, II.10: seven stars in the plane, mᵢ = i.
    const STARS: usize = 7;
    let stars = plain(
        4 * STARS,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[..2 * STARS].copy_from_slice(&y[2 * STARS..]);
            dy[2 * STARS..].fill(0.0);
            for i in 0..STARS {
                for j in 0..STARS {
                    if i != j {
                        let (x, z) = (y[j] - y[i], y[STARS + j] - y[STARS + i]);
                        let pull = (j + 1) as f64 / x.hypot(z).powi(3);
                        dy[2 * STARS + i] += pull * x;
                        dy[3 * STARS + i] += pull * z;
                    }
                }
            }
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            for i in 0..STARS {
                set(i, 2 * STARS + i, 1.0);
                set(STARS + i, 3 * STARS + i, 1.0);
                let mut own = [0.0; 3];
                for j in (0..STARS).filter(|&j| j != i) {
                    let (x, z) = (y[j] - y[i], y[STARS + j] - y[STARS + i]);
                    let r = x.hypot(z);
                    let (pull, more) =
                        ((j + 1) as f64 / r.powi(3), 3.0 * (j + 1) as f64 / r.powi(5));
                    let of = [pull - more * x * x, -more * x * z, pull - more * z * z];
                    set(2 * STARS + i, j, of[0]);
                    set(2 * STARS + i, STARS + j, of[1]);
                    set(3 * STARS + i, j, of[1]);
                    set(3 * STARS + i, STARS + j, of[2]);
                    for (own, of) in own.iter_mut().zip(of) {
                        *own -= of;
                    }
                }
                set(2 * STARS + i, i, own[0]);
                set(2 * STARS + i, STARS + i, own[1]);
                set(3 * STARS + i, i, own[1]);
                set(3 * STARS + i, STARS + i, own[2]);
            }
        },
    );
    let mut start = [0.0; 4 * STARS];
    start[..2 * STARS].copy_from_slice(&[
        3.0, 3.0, -1.0, -3.0, 2.0, -2.0, 2.0, 3.0, -3.0, 2.0, 0.0, 0.0, -4.0, 4.0,
    ]);
    (start[2 * STARS + 5], start[2 * STARS + 6]) = (1.75, -1.5);
    (start[3 * STARS + 3], start[3 * STARS + 4]) = (-1.25, 1.0);
    bench.plain(
        "Pleiades",
        &stars,
        &start,
        evenly(3.0),
        &[1.0; 4 * STARS],
        Reference::Fixed(4000),
    );
    // A mass on a moving belt and a spring, with friction 5 tanh((belt − v)/0.001): stiff where it sticks.
    let belt = plain(
        2,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[0] = y[1];
            dy[1] = -10.0 * y[0] + 5.0 * ((0.3 - y[1]) / 1e-3).tanh();
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 1, 1.0);
            set(1, 0, -10.0);
            set(1, 1, -5e3 / ((0.3 - y[1]) / 1e-3).cosh().powi(2));
        },
    );
    bench.plain(
        "mass on a moving belt",
        &belt,
        &[1.0, 0.0],
        evenly(10.0),
        &[1.0; 2],
        Reference::Implicit,
    );

    // What follows was not looked at while the changes were made what they are.

    // O'Malley and Shampine: a ball of flame, ẏ = y² − y³, which grows slowly, suddenly, and then stays, stiffly.
    const START: f64 = 1e-4;
    let flame = plain(
        1,
        |_t, y: &[f64], dy: &mut [f64]| dy[0] = y[0] * y[0] * (1.0 - y[0]),
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 0, y[0] * (2.0 - 3.0 * y[0]));
        },
    );
    bench.plain(
        "flame",
        &flame,
        &[START],
        evenly(2.0 / START),
        &[START],
        Reference::Implicit,
    );
    // Hairer and Wanner II, X: E5 of Enright, Hull and Lindberg (1975).
    const RATES: [f64; 4] = [7.89e-10, 1.1e7, 1.13e9, 1.13e3];
    let e5 = plain(
        4,
        |_t, y: &[f64], dy: &mut [f64]| {
            let [a, b, c, d] = [
                RATES[0] * y[0],
                RATES[1] * y[0] * y[2],
                RATES[2] * y[1] * y[2],
                RATES[3] * y[3],
            ];
            dy[0] = -a - b;
            dy[1] = a - c;
            dy[2] = a - b - c + d;
            dy[3] = b - d;
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            let [a, b, c, d] = RATES;
            set(0, 0, -a - b * y[2]);
            set(0, 2, -b * y[0]);
            set(1, 0, a);
            set(1, 1, -c * y[2]);
            set(1, 2, -c * y[1]);
            set(2, 0, a - b * y[2]);
            set(2, 1, -c * y[2]);
            set(2, 2, -b * y[0] - c * y[1]);
            set(2, 3, d);
            set(3, 0, b * y[2]);
            set(3, 2, b * y[0]);
            set(3, 3, -d);
        },
    );
    bench.plain(
        "E5, 1e5 s",
        &e5,
        &[1.76e-3, 0.0, 0.0, 0.0],
        in_decades(1e-2, 1e5),
        &[1e-3, 1e-10, 1e-13, 1e-10],
        Reference::Implicit,
    );
}
