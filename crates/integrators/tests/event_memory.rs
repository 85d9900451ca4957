//! Steps through events take no memory after the first ones.
#![allow(clippy::unwrap_used)] // helpers of tests

use std::convert::Infallible;

use integrators::event::{Coulomb, EventStepper, Law, Masses};

#[test]
fn slides_rests_and_impacts_allocate_nothing() {
    // Two bodies with play between them, dragged to and fro on the ground.
    let bodies = Masses::new(2, |t: f64, (_q, _v), _u: &(), mass, force| {
        (mass[(0, 0)], mass[(1, 1)]) = (1.0, 0.4);
        force.copy_from_slice(&[3.0 * (4.0 * t).sin(), 0.0]);
        Ok::<(), Infallible>(())
    });
    let laws = vec![
        Law::friction(&[1.0, 0.0], Coulomb::new(0.6)),
        Law::friction(&[0.0, 1.0], Coulomb::new(0.2)),
        Law::stop(&[1.0, -1.0], 0.1, 0.3),
        Law::stop(&[-1.0, 1.0], 0.1, 0.3),
    ];
    let mut stepper = EventStepper::new(&bodies, laws).unwrap();
    let mut x = [0.0; 4];
    let mut events = 0;
    let mut run = |from: usize, to: usize| {
        for k in from..to {
            stepper
                .advance(&bodies, (0.01 * k as f64, 0.01, 5), &(), &mut x)
                .unwrap();
            events += stepper.events().len();
            stepper.clear_events();
        }
        std::mem::take(&mut events)
    };
    assert!(run(0, 500) > 10);
    let mut happened = 0;
    let counted = allocation_counter::measure(|| happened = run(500, 2000));
    assert!(happened > 30, "{happened} events");
    assert_eq!(counted.count_total, 0);
}
