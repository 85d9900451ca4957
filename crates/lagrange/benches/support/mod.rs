//! What the benches share: the clock, the robots and their states.
#![allow(dead_code)] // every bench takes its part

pub mod cpu_time;
pub mod random;
pub mod robot;

use std::time::Duration;

use criterion::Criterion;

use cpu_time::CpuTime;

/// Thread CPU time; short, for there are many calls to time.
pub fn criterion() -> Criterion<CpuTime> {
    Criterion::default()
        .with_measurement(CpuTime)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(600))
        .sample_size(40)
        .nresamples(2000)
        .configure_from_args()
}
