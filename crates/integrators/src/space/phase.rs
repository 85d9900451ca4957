use std::ops::Range;

use super::Space;

/// States x = (q, v) over a space of positions: q moves in it, v is one of its tangents and adds.
///
/// A tangent is (δq, δv), 2 nv entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhaseSpace<P> {
    /// The space of q.
    pub positions: P,
}

impl<P: Space> PhaseSpace<P> {
    fn halves<'a>(&self, tangent: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        tangent.split_at(self.positions.tangent_dim())
    }
}

impl<P: Space> Space for PhaseSpace<P> {
    fn dim(&self) -> usize {
        self.positions.dim() + self.positions.tangent_dim()
    }
    fn tangent_dim(&self) -> usize {
        2 * self.positions.tangent_dim()
    }
    fn is_flat(&self) -> bool {
        self.positions.is_flat()
    }
    fn curved(&self) -> Range<usize> {
        self.positions.curved()
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        let (q, v) = point.split_at(self.positions.dim());
        let (dq, dv) = self.halves(motion);
        let (q_out, v_out) = out.split_at_mut(self.positions.dim());
        self.positions.move_into(q, dq, q_out);
        for ((out, v), d) in v_out.iter_mut().zip(v).zip(dv) {
            *out = v + d;
        }
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        let (q_from, v_from) = from.split_at(self.positions.dim());
        let (q_to, v_to) = to.split_at(self.positions.dim());
        let (dq, dv) = out.split_at_mut(self.positions.tangent_dim());
        self.positions.difference_into(q_from, q_to, dq);
        for ((out, a), b) in dv.iter_mut().zip(v_from).zip(v_to) {
            *out = b - a;
        }
    }
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        let (dq, dv) = out.split_at_mut(self.positions.tangent_dim());
        self.positions
            .bracket_into(self.halves(a).0, self.halves(b).0, dq);
        dv.fill(0.0);
    }
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        let (dq, dv) = out.split_at_mut(self.positions.tangent_dim());
        self.positions
            .cobracket_into(self.halves(a).0, self.halves(m).0, dq);
        dv.fill(0.0);
    }
    fn distance(&self, point: &[f64]) -> f64 {
        let (q, _) = point.split_at(self.positions.dim());
        self.positions.distance(q)
    }
    fn scale_into(&self, point: &[f64], out: &mut [f64]) {
        let (q, v) = point.split_at(self.positions.dim());
        let (dq, dv) = out.split_at_mut(self.positions.tangent_dim());
        self.positions.scale_into(q, dq);
        dv.copy_from_slice(v);
    }
}
