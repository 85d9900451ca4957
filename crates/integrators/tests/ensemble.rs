//! Many roll-outs at once against one at a time.

use std::convert::Infallible;

use crate::systems::{Pendulum, Top};
use integrators::ensemble::{
    LANES, LaneMember, LaneSystem, Member, RolledOut, gradients, roll_outs, roll_outs_in_lanes,
};
use integrators::gradient::{Adjoint, GradientError, RollOutGradient, Schedule};
use integrators::{
    Flat, Gradient, Heun, PhaseSpace, Rk4, RollOutError, Rotation, StepError, System, roll_out,
};

/// Evaluates the rate lane by lane, with the same rounding.
fn lane_by_lane<S: System>(
    system: &S,
    t: f64,
    (x, u): (&[[f64; LANES]], [&S::Input; LANES]),
    memory: &mut S::Memory,
    dx: &mut [[f64; LANES]],
) -> Result<(), S::Error> {
    for lane in 0..LANES {
        let one: Vec<f64> = x.iter().map(|x| x[lane]).collect();
        let mut rate = vec![0.0; dx.len()];
        system.rate(t, &one, u[lane], memory, &mut rate)?;
        for (dx, rate) in dx.iter_mut().zip(rate) {
            dx[lane] = rate;
        }
    }
    Ok(())
}

impl LaneSystem for Pendulum {
    fn rate_lanes(
        &self,
        _t: f64,
        x: &[[f64; LANES]],
        u: [&[f64; 1]; LANES],
        (): &mut (),
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Infallible> {
        dx[0] = x[1];
        for k in 0..LANES {
            dx[1][k] = -(x[0][k].sin() * self.p[0]) - x[1][k] * self.p[1] + u[k][0];
        }
        Ok(())
    }
}

impl LaneSystem for Top {
    fn rate_lanes(
        &self,
        t: f64,
        x: &[[f64; LANES]],
        u: [&[f64; 3]; LANES],
        memory: &mut Gradient,
        dx: &mut [[f64; LANES]],
    ) -> Result<(), Infallible> {
        lane_by_lane(self, t, (x, u), memory, dx)
    }
}

/// ẏ = y², ṫ = 1: y escapes at 1/y(0). Where y would be more than the input, it has no rate.
struct Escape(Flat);

impl System for Escape {
    type Space = Flat;
    type Input = f64;
    type Memory = ();
    type Error = &'static str;
    fn space(&self) -> &Flat {
        &self.0
    }
    fn memory(&self) {}
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        most: &f64,
        (): &mut (),
        dx: &mut [f64],
    ) -> Result<(), &'static str> {
        dx[0] = x[0] * x[0];
        dx[1] = 1.0;
        if x[0] > *most {
            Err("too fast")
        } else {
            Ok(())
        }
    }
}

impl LaneSystem for Escape {
    fn rate_lanes(
        &self,
        t: f64,
        x: &[[f64; LANES]],
        u: [&f64; LANES],
        memory: &mut (),
        dx: &mut [[f64; LANES]],
    ) -> Result<(), &'static str> {
        lane_by_lane(self, t, (x, u), memory, dx)
    }
}

fn in_threads<T: Send>(threads: usize, call: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
        .install(call)
}

fn times(samples: usize, step: f64) -> Vec<f64> {
    (0..samples).map(|k| step * k as f64).collect()
}

fn bits<E>(rolled: &[RolledOut<E>]) -> Vec<Option<Vec<u64>>> {
    rolled
        .iter()
        .map(|rows| {
            let rows = rows.as_ref().ok()?;
            Some(rows.iter().flatten().map(|x| x.to_bits()).collect())
        })
        .collect()
}

/// 21 pendulums: two full groups and one of five.
fn swings() -> Vec<([f64; 2], Vec<[f64; 1]>)> {
    (0..21)
        .map(|m| {
            let m = f64::from(m);
            let inputs = (0..9).map(|k| [(m + 0.3 * f64::from(k)).sin()]).collect();
            ([0.1 * m, 1.0 - 0.05 * m], inputs)
        })
        .collect()
}

#[test]
fn pendulums_in_lanes_and_threads_are_pendulums_one_at_a_time_to_the_bit() {
    let (pendulum, times, swings) = (Pendulum::new(), times(10, 0.2), swings());
    let expected: Vec<_> = swings
        .iter()
        .map(|(start, u)| roll_out(&pendulum, Rk4::default(), &times, u, 6, start))
        .collect();
    let by_heun: Vec<_> = swings
        .iter()
        .map(|(start, u)| roll_out(&pendulum, Heun::default(), &times, u, 6, start))
        .collect();
    let members: Vec<_> = swings
        .iter()
        .map(|(initial, inputs)| Member {
            system: &pendulum,
            schedule: Schedule {
                times: &times,
                inputs,
                substeps: 6,
            },
            initial,
        })
        .collect();
    let in_lanes: Vec<_> = swings
        .iter()
        .map(|(initial, inputs)| LaneMember { inputs, initial })
        .collect();
    for threads in [1, 2, 5] {
        let rolled = in_threads(threads, || roll_outs(&members, &Rk4::default()));
        assert_eq!(bits(&rolled), bits(&expected), "{threads} threads");
        let rolled = in_threads(threads, || {
            roll_outs_in_lanes(&pendulum, &Rk4::default(), &times, 6, &in_lanes)
        });
        assert_eq!(bits(&rolled), bits(&expected), "lanes, {threads} threads");
        let rolled = in_threads(threads, || {
            roll_outs_in_lanes(&pendulum, &Heun::default(), &times, 6, &in_lanes)
        });
        assert_eq!(bits(&rolled), bits(&by_heun), "lanes, {threads} threads");
    }
}

#[test]
fn tops_in_lanes_stay_on_their_quaternions() {
    let top = Top::new(3.0);
    let times = times(6, 0.1);
    let starts: Vec<[f64; 7]> = (0..11)
        .map(|m| {
            let angle = 0.2 * f64::from(m);
            [
                angle.cos(),
                0.0,
                angle.sin(),
                0.0,
                0.5,
                -0.1 * f64::from(m),
                3.0,
            ]
        })
        .collect();
    let inputs = [[0.1, 0.0, -0.1]; 5];
    let members: Vec<_> = starts
        .iter()
        .map(|initial| LaneMember {
            inputs: &inputs,
            initial,
        })
        .collect();
    let expected: Vec<_> = starts
        .iter()
        .map(|start| roll_out(&top, Rk4::default(), &times, &inputs, 3, start))
        .collect();
    for threads in [1, 2, 5] {
        let rolled = in_threads(threads, || {
            roll_outs_in_lanes(&top, &Rk4::default(), &times, 3, &members)
        });
        assert_eq!(bits(&rolled), bits(&expected), "{threads} threads");
    }
    let _: &PhaseSpace<Rotation> = top.space();
}

#[test]
fn the_failure_of_one_lane_is_its_own() {
    let escape = Escape(Flat::new(2));
    let times = times(11, 0.1);
    // y(0) = 0.3 stays below 0.5 until t = 1; 2 escapes at t = 0.5; NaN and a short state do not start.
    let quiet = vec![0.3, 0.0];
    let starts = [
        quiet.clone(),
        vec![2.0, 0.0],
        quiet.clone(),
        vec![f64::NAN, 0.0],
        quiet.clone(),
        vec![1.0],
        quiet.clone(),
        vec![1.9, 0.0],
        quiet.clone(),
    ];
    let (free, bounded) = ([1e300; 10], [5.0; 10]);
    let members: Vec<_> = starts
        .iter()
        .enumerate()
        .map(|(k, initial)| LaneMember {
            inputs: if k == 7 { &bounded } else { &free },
            initial,
        })
        .collect();
    let expected: Vec<_> = members
        .iter()
        .map(|member| {
            roll_out(
                &escape,
                Rk4::default(),
                &times,
                member.inputs,
                4,
                member.initial,
            )
        })
        .collect();
    for threads in [1, 2, 5] {
        let rolled = in_threads(threads, || {
            roll_outs_in_lanes(&escape, &Rk4::default(), &times, 4, &members)
        });
        for (k, (found, expected)) in rolled.iter().zip(&expected).enumerate() {
            match (found, expected) {
                (Err(found), Err(expected)) => {
                    assert_eq!(found.to_string(), expected.to_string(), "member {k}");
                }
                _ => assert_eq!(found, expected, "member {k}"),
            }
        }
        assert!(matches!(
            rolled[3],
            Err(RollOutError::NotFinite { component: 0, .. })
        ));
        assert!(matches!(
            rolled[5],
            Err(RollOutError::Initial { found: 1, .. })
        ));
        assert!(matches!(
            rolled[7],
            Err(RollOutError::Step {
                source: StepError::RightHandSide("too fast"),
                ..
            })
        ));
        assert!([0, 2, 4, 6, 8].iter().all(|&k| rolled[k].is_ok()));
    }
    // Nobody is left.
    let nobody = [members[3], members[5]];
    let rolled = roll_outs_in_lanes(&escape, &Rk4::default(), &times, 4, &nobody);
    assert!(rolled.iter().all(Result::is_err) && rolled.len() == 2);
    assert!(roll_outs_in_lanes(&escape, &Rk4::default(), &times, 4, &[]).is_empty());
}

#[test]
fn gradients_of_an_ensemble_are_those_of_its_members_for_any_number_of_threads() {
    let (times, swings) = (times(10, 0.2), swings());
    // Every member has constants of its own.
    let pendulums: Vec<Pendulum> = (0..swings.len())
        .map(|m| {
            let mut pendulum = Pendulum::new();
            pendulum.p[0] += 0.1 * m as f64;
            pendulum
        })
        .collect();
    let members: Vec<_> = swings
        .iter()
        .zip(&pendulums)
        .map(|((initial, inputs), system)| Member {
            system,
            schedule: Schedule {
                times: &times,
                inputs,
                substeps: 6,
            },
            initial,
        })
        .collect();
    let loss = |member: usize, k: usize, x: &[f64], by: &mut [f64]| {
        let weight = 1.0 + (member * k) as f64;
        by[0] = weight * x[0];
        0.5 * weight * x[0] * x[0]
    };
    let (mut sum, mut parameters, mut expected) = (0.0, vec![0.0; 2], Vec::new());
    for (m, member) in members.iter().enumerate() {
        let mut by = RollOutGradient::default();
        sum += Adjoint::new(member.system, Rk4::default())
            .gradient(
                member.system,
                member.schedule,
                member.initial,
                |k, x, by| loss(m, k, x, by),
                &mut by,
            )
            .unwrap();
        parameters[0] += by.parameters[0];
        parameters[1] += by.parameters[1];
        expected.push(by);
    }
    for threads in [1, 2, 5] {
        let found = in_threads(threads, || {
            gradients(&members, &Rk4::default(), 2_000, loss)
        });
        assert_eq!(found.total().unwrap(), (sum, parameters.clone()));
        for (found, expected) in found.members.iter().zip(&expected) {
            assert_eq!(&found.as_ref().unwrap().by, expected);
        }
    }

    // One without a gradient is named, and the others have theirs.
    let mut broken = members.clone();
    broken[4].initial = &[f64::INFINITY, 0.0];
    let found = gradients(&broken, &Rk4::default(), 2_000, loss);
    let error = found.total().unwrap_err();
    assert_eq!(error.member, 4);
    assert!(matches!(
        error.source,
        GradientError::RollOut(RollOutError::NotFinite { component: 0, .. })
    ));
    assert_eq!(found.members[5].as_ref().unwrap().by, expected[5]);
}
