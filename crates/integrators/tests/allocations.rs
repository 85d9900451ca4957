//! A step allocates nothing once a method has seen the system.

#![allow(clippy::unwrap_used, clippy::panic)]

use integrators::problems::{HeavyTop, Kepler, Problem};
use integrators::{Heun, Method, Order, Rk4, StormerVerlet, SymplecticEuler, Variational};

fn allocations<P: Problem>(problem: &P, mut method: impl Method<P>) -> u64 {
    let mut x = problem.initial();
    let mut step = || {
        if let Err(error) = method.step(problem, 0.0, 0.01, &(), &mut (), &mut x) {
            panic!("{error}");
        }
    };
    step();
    allocation_counter::measure(|| (0..100).for_each(|_| step())).count_total
}

#[test]
fn steps_of_every_method_allocate_nothing() {
    // The counter counts.
    let vector = allocation_counter::measure(|| drop(std::hint::black_box(vec![1.0; 4])));
    assert_eq!(vector.count_total, 1);
    let kepler = Kepler { eccentricity: 0.3 };
    let top = HeavyTop::default();
    for (name, count) in [
        ("Heun", allocations(&kepler, Heun::default())),
        ("Heun, turning", allocations(&top, Heun::default())),
        ("RK4", allocations(&kepler, Rk4::default())),
        ("RK4, turning", allocations(&top, Rk4::default())),
        (
            "symplectic Euler",
            allocations(&kepler, SymplecticEuler::new(&kepler).unwrap()),
        ),
        (
            "Störmer-Verlet",
            allocations(&kepler, StormerVerlet::new(&kepler).unwrap()),
        ),
        (
            "variational",
            allocations(&kepler, Variational::new(&kepler, Order::Four)),
        ),
        (
            "variational, turning",
            allocations(&top, Variational::new(&top, Order::Four)),
        ),
    ] {
        assert_eq!(count, 0, "{name}");
    }
}
