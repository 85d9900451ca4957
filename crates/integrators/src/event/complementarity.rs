//! The linear complementarity problem in a box, by pivoting.
//!
//! Given A = Aᵀ positive (semi)definite, b and bounds l ≤ 0 ≤ h, find x in the box with, for y = A x + b and every i:
//!
//! - y_i = 0 where l_i < x_i < h_i,
//! - y_i ≥ 0 where x_i = l_i,
//! - y_i ≤ 0 where x_i = h_i; any y_i where l_i = h_i.
//!
//! For contacts x are the forces and y the accelerations along their directions. It is solved exactly, up to rounding, by Dantzig's
//! method of driving one variable after the other to where it is complementary (Cottle, Pang and Stone, "The Linear
//! Complementarity Problem", 1992, 4.2; Baraff, "Fast contact force computation for nonpenetrating rigid bodies", 1994). If A is
//! definite the x is unique; if rows of A depend on each other, as where two laws say the same, y is, and of the x one is found in
//! which earlier variables carry what they can.

use super::factor::{DEPENDENT, factorise, solve};

/// Where a variable is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// Not driven yet.
    Waiting,
    /// y = 0.
    Free,
    Lower,
    Upper,
}

/// y counts as 0 below this part of the sum of the sizes of its terms.
const ZERO: f64 = 1e-14;

/// A solver with its memory; it takes more only for a larger problem.
#[derive(Debug, Clone, Default)]
pub(super) struct Complementarity {
    n: usize,
    /// Row i, column j at i n + j.
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    pub place: Vec<Place>,
    /// Variables with y = 0, in the order in which they came.
    pub free: Vec<usize>,
    factor: Vec<f64>,
    way: Vec<f64>,
    free_way: Vec<f64>,
    y_way: Vec<f64>,
}

/// No pivot leads on: numbers that are not finite, or a b that A cannot reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Unsolved;

/// What ends a drive.
#[derive(Clone, Copy)]
enum Block {
    Nothing,
    Balanced,
    Bound(usize),
    Lets(usize),
}

impl Complementarity {
    /// Memory for n variables, with 0 in A and b and a box of no width.
    pub fn resize(&mut self, n: usize) {
        self.n = n;
        self.a.clear();
        self.a.resize(n * n, 0.0);
        for vector in [
            &mut self.b,
            &mut self.lower,
            &mut self.upper,
            &mut self.x,
            &mut self.y,
            &mut self.way,
            &mut self.y_way,
        ] {
            vector.clear();
            vector.resize(n, 0.0);
        }
        self.place.clear();
        self.place.resize(n, Place::Waiting);
        self.free.clear();
    }

    /// Sum of the sizes of the terms of y_i.
    pub fn scale(&self, i: usize) -> f64 {
        let row = &self.a[i * self.n..(i + 1) * self.n];
        let terms = row.iter().zip(&self.x).map(|(a, x)| (a * x).abs());
        self.b[i].abs() + terms.sum::<f64>()
    }

    /// Solves for x and y.
    pub fn solve(&mut self) -> Result<(), Unsolved> {
        self.x.fill(0.0);
        self.place.fill(Place::Waiting);
        self.free.clear();
        self.balance();
        let mut pivots = 50 + 20 * self.n;
        for i in 0..self.n {
            while self.place[i] == Place::Waiting {
                pivots = pivots.checked_sub(1).ok_or(Unsolved)?;
                self.drive(i)?;
            }
        }
        Ok(())
    }

    /// y = A x + b.
    fn balance(&mut self) {
        for (i, y) in self.y.iter_mut().enumerate() {
            let row = &self.a[i * self.n..(i + 1) * self.n];
            *y = self.b[i] + row.iter().zip(&self.x).map(|(a, x)| a * x).sum::<f64>();
        }
    }

    /// Moves x_i, and with it the free variables so that their y stay 0, until it is complementary or another variable changes
    /// its place.
    fn drive(&mut self, i: usize) -> Result<(), Unsolved> {
        let n = self.n;
        if !self.y[i].is_finite() {
            return Err(Unsolved);
        }
        if self.y[i].abs() <= ZERO * self.scale(i) {
            self.settle(i);
            return Ok(());
        }
        let sign = -self.y[i].signum();
        if (sign < 0.0 && self.x[i] <= self.lower[i]) || (sign > 0.0 && self.x[i] >= self.upper[i])
        {
            self.settle(i);
            return Ok(());
        }
        self.find_way(i, sign);

        let (mut step, mut block) = (f64::INFINITY, Block::Nothing);
        let mut limit = |s: f64, by: Block| {
            if s < step {
                (step, block) = (s.max(0.0), by);
            }
        };
        if self.y_way[i].abs() > DEPENDENT * self.a[i * n + i] {
            limit(-self.y[i] / self.y_way[i], Block::Balanced);
        }
        for j in (0..=i).filter(|&j| j == i || self.place[j] == Place::Free) {
            let (x, way) = (self.x[j], self.way[j]);
            if way > 0.0 {
                limit((self.upper[j] - x) / way, Block::Bound(j));
            } else if way < 0.0 {
                limit((self.lower[j] - x) / way, Block::Bound(j));
            }
        }
        for j in 0..i {
            let (y, way) = (self.y[j], self.y_way[j]);
            let reach = (self.a[j * n + j] * self.a[i * n + i]).sqrt();
            if self.lower[j] == self.upper[j] || way.abs() <= DEPENDENT * reach {
                continue;
            }
            match self.place[j] {
                Place::Lower if way < 0.0 => limit(-y / way, Block::Lets(j)),
                Place::Upper if way > 0.0 => limit(-y / way, Block::Lets(j)),
                _ => {}
            }
        }

        if step.is_finite() {
            for (x, way) in self.x.iter_mut().zip(&self.way) {
                *x += step * way;
            }
        }
        match block {
            // Along a direction that moves nothing: what is left of y_i must be rounding.
            Block::Nothing if self.y[i].abs() <= 1e-9 * self.scale(i) => self.settle(i),
            Block::Nothing => return Err(Unsolved),
            Block::Balanced => {
                self.place[i] = Place::Free;
                self.free.push(i);
            }
            Block::Bound(j) => {
                let at_upper = self.way[j] > 0.0;
                self.x[j] = if at_upper {
                    self.upper[j]
                } else {
                    self.lower[j]
                };
                self.place[j] = if at_upper { Place::Upper } else { Place::Lower };
                self.free.retain(|&k| k != j);
            }
            Block::Lets(j) => {
                self.place[j] = Place::Free;
                self.free.push(j);
            }
        }
        self.balance();
        Ok(())
    }

    /// Says where x_i is.
    fn settle(&mut self, i: usize) {
        self.place[i] = if self.x[i] <= self.lower[i] {
            Place::Lower
        } else if self.x[i] >= self.upper[i] {
            Place::Upper
        } else {
            self.free.push(i);
            Place::Free
        };
    }

    /// The way of x where x_i moves by `sign` and y of the free variables stays, and the way of y.
    fn find_way(&mut self, i: usize, sign: f64) {
        let (n, m) = (self.n, self.free.len());
        self.factor.clear();
        self.free_way.clear();
        for &j in &self.free {
            for &k in &self.free {
                self.factor.push(self.a[j * n + k]);
            }
            self.free_way.push(-sign * self.a[j * n + i]);
        }
        factorise(&mut self.factor, m, DEPENDENT);
        solve(&self.factor, m, &mut self.free_way);
        self.way.fill(0.0);
        self.way[i] = sign;
        for (&j, &way) in self.free.iter().zip(&self.free_way) {
            self.way[j] = way;
        }
        for (k, y_way) in self.y_way.iter_mut().enumerate() {
            let row = &self.a[k * n..(k + 1) * n];
            *y_way = row.iter().zip(&self.way).map(|(a, d)| a * d).sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every way to put the variables at their bounds or free, until one is complementary: the definition, word for word.
    fn by_enumeration(problem: &Complementarity) -> Option<(Vec<f64>, Vec<f64>)> {
        let n = problem.n;
        (0..3_usize.pow(n as u32)).find_map(|code| {
            let place = |i: usize| code / 3_usize.pow(i as u32) % 3;
            let free: Vec<usize> = (0..n).filter(|&i| place(i) == 2).collect();
            let mut x: Vec<f64> = (0..n)
                .map(|i| [problem.lower[i], problem.upper[i], 0.0][place(i)])
                .collect();
            if x.iter().any(|x| x.is_infinite()) {
                return None;
            }
            let row = |x: &[f64], i: usize| -> f64 {
                problem.b[i] + (0..n).map(|j| problem.a[i * n + j] * x[j]).sum::<f64>()
            };
            let m = free.len();
            let a = nalgebra::DMatrix::from_fn(m, m, |r, c| problem.a[free[r] * n + free[c]]);
            let rhs = nalgebra::DVector::from_fn(m, |r, _| -row(&x, free[r]));
            if m > 0 {
                for (&i, value) in free.iter().zip(&a.lu().solve(&rhs)?) {
                    x[i] = *value;
                }
            }
            let y: Vec<f64> = (0..n).map(|i| row(&x, i)).collect();
            let fits = (0..n).all(|i| match place(i) {
                0 => y[i] >= -1e-12 || problem.lower[i] == problem.upper[i],
                1 => y[i] <= 1e-12 || problem.lower[i] == problem.upper[i],
                _ => (problem.lower[i] - 1e-12..=problem.upper[i] + 1e-12).contains(&x[i]),
            });
            fits.then_some((x, y))
        })
    }

    /// A = R Rᵀ for the n × k matrix R, of rank k at most, and b in its span if it is less than n.
    fn problem(n: usize, k: usize, entries: &[f64], ridge: f64) -> Complementarity {
        let mut problem = Complementarity::default();
        problem.resize(n);
        let r = |i: usize, j: usize| entries[(i * k + j) % entries.len()];
        for i in 0..n {
            for j in 0..n {
                problem.a[i * n + j] = (0..k).map(|l| r(i, l) * r(j, l)).sum::<f64>();
            }
            problem.a[i * n + i] += ridge;
            problem.b[i] = (0..k)
                .map(|l| r(i, l) * entries[entries.len() - 1 - l])
                .sum();
            let width = entries[(7 * i + 3) % entries.len()].abs();
            (problem.lower[i], problem.upper[i]) = match i % 3 {
                0 => (0.0, f64::INFINITY),
                1 => (-width, 0.5 * width),
                _ => (-0.3 * width, width),
            };
        }
        problem
    }

    fn check(problem: &Complementarity) {
        for i in 0..problem.n {
            let zero = 1e-9 * (1.0 + problem.scale(i));
            let (x, y) = (problem.x[i], problem.y[i]);
            let (lower, upper) = (problem.lower[i], problem.upper[i]);
            assert!((lower..=upper).contains(&x), "x[{i}] = {x}");
            assert!(y >= -zero || x == upper, "y[{i}] = {y} inside the box");
            assert!(y <= zero || x == lower, "y[{i}] = {y} inside the box");
        }
    }

    proptest! {
        #[test]
        fn pivoting_finds_what_enumeration_finds(
            n in 1_usize..6,
            entries in proptest::collection::vec(-1.0..1.0_f64, 40),
        ) {
            let mut problem = problem(n, n, &entries, 0.05);
            problem.solve().unwrap();
            check(&problem);
            let (x, y) = by_enumeration(&problem).unwrap();
            for i in 0..n {
                prop_assert!((problem.x[i] - x[i]).abs() < 1e-9, "x[{i}]");
                prop_assert!((problem.y[i] - y[i]).abs() < 1e-9, "y[{i}]");
            }
        }

        #[test]
        fn dependent_rows_have_a_solution_all_the_same(
            n in 2_usize..9,
            rank in 1_usize..4,
            entries in proptest::collection::vec(-1.0..1.0_f64, 60),
        ) {
            let mut problem = problem(n, rank.min(n - 1), &entries, 0.0);
            problem.solve().unwrap();
            check(&problem);
        }

        #[test]
        fn thirty_laws_at_once_are_solved(entries in proptest::collection::vec(-1.0..1.0_f64, 997)) {
            let mut problem = problem(30, 30, &entries, 0.01);
            problem.solve().unwrap();
            check(&problem);
        }
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let mut problem = problem(2, 2, &[0.5, -0.3, 0.8, 0.2, 0.9], 0.1);
        problem.b[1] = f64::NAN;
        assert_eq!(problem.solve(), Err(Unsolved));
    }
}
