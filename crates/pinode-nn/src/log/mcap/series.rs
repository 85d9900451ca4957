//! What one column tells over time, and what it says in between.

use std::f64::consts::TAU;
use std::rc::Rc;

/// Readings of one column.
#[derive(Default)]
pub(super) struct Series {
    /// Which message of the topic each stands in.
    pub messages: Vec<u32>,
    pub numbers: Vec<f64>,
    /// Only of ids: as long as `numbers`, or empty.
    pub texts: Vec<Rc<str>>,
    /// When each was read, ns, increasing.
    pub times: Vec<i64>,
}

impl Series {
    /// Gives every reading the time of its message, and sorts them by it.
    pub(super) fn place(&mut self, times: &[i64]) {
        let time = |message: &u32| times.get(*message as usize).copied().unwrap_or(0);
        self.times = self.messages.iter().map(time).collect();
        if self.times.is_sorted() {
            return;
        }
        let mut order: Vec<usize> = (0..self.times.len()).collect();
        order.sort_by_key(|index| self.times.get(*index));
        sort(&mut self.times, &order);
        sort(&mut self.numbers, &order);
        sort(&mut self.texts, &order);
    }

    /// Index of the last reading at `time` or before.
    pub(super) fn held(&self, time: i64) -> Option<usize> {
        self.times.partition_point(|t| *t <= time).checked_sub(1)
    }

    /// The reading before `time`, how far `time` is on the way to the next, from 0 to 1, and how far these two are apart, ns; none where `time` is that of a
    /// reading, or there are no two around it.
    pub(super) fn around(&self, time: i64) -> Option<(usize, f64, i64)> {
        let before = self.held(time)?;
        let (start, end) = (*self.times.get(before)?, *self.times.get(before + 1)?);
        let share = (time - start) as f64 / (end - start) as f64;
        (start != time).then_some((before, share, end - start))
    }

    /// The number on the line between the readings around `time`, and how far these are apart; where the number goes round with
    /// `period`, the shorter way.
    pub(super) fn between(&self, time: i64, period: Option<f64>) -> Option<(f64, i64)> {
        let before = self.held(time)?;
        let x0 = *self.numbers.get(before)?;
        if *self.times.get(before)? == time {
            return Some((x0, 0));
        }
        let (_, share, apart) = self.around(time)?;
        let mut difference = *self.numbers.get(before + 1)? - x0;
        if let Some(period) = period {
            difference -= period * (difference / period).round();
        }
        Some((x0 + share * difference, apart))
    }
}

/// The period of an angle in the column that becomes one by `scale`.
pub(super) fn period(scale: f64) -> Option<f64> {
    Some(TAU / scale.abs()).filter(|period| period.is_finite())
}

fn sort<T: Clone>(values: &mut Vec<T>, order: &[usize]) {
    if values.len() == order.len() {
        *values = order
            .iter()
            .filter_map(|index| values.get(*index).cloned())
            .collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series() -> Series {
        let mut series = Series {
            messages: vec![0, 1, 2],
            numbers: vec![1.0, 3.0, -3.0],
            ..Series::default()
        };
        series.place(&[10, 30, 20]);
        series
    }

    #[test]
    fn readings_are_sorted_by_time_and_held_until_the_next() {
        let series = series();
        assert_eq!(series.times, [10, 20, 30]);
        assert_eq!(series.numbers, [1.0, -3.0, 3.0]);
        let held = [9, 10, 19, 20, 99].map(|time| series.held(time));
        assert_eq!(held, [None, Some(0), Some(0), Some(1), Some(2)]);
    }

    #[test]
    fn numbers_between_readings_lie_on_a_line_or_on_the_shorter_arc() {
        let series = series();
        assert_eq!(series.between(15, None), Some((-1.0, 10)));
        assert_eq!(series.between(20, None), Some((-3.0, 0)));
        assert_eq!(series.between(30, None), Some((3.0, 0)));
        assert_eq!(series.between(31, None), None);
        assert_eq!(series.between(9, None), None);
        let around = series.between(25, Some(TAU));
        let angle = around.map_or(f64::NAN, |(angle, _)| angle);
        assert!((angle + TAU / 2.0).abs() < 1e-12, "{angle}");
    }
}
