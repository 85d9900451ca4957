//! Whether what was named is what was hidden.

use super::Line;
use super::line::{Named, Truth};

impl Named {
    /// Whether this is the name of `truth`, or the diagnosis says that the data cannot tell it from that.
    pub fn is(&self, truth: &Truth) -> bool {
        let same = |kind: &str, target: &str| kind == truth.kind && target == truth.target;
        same(&self.kind, &self.target)
            || self
                .indistinguishable_from
                .iter()
                .any(|name| same(&name.kind, &name.target))
    }

    /// Whether this is the name of `truth` itself.
    pub fn is_exactly(&self, truth: &Truth) -> bool {
        self.kind == truth.kind && self.target == truth.target
    }
}

impl Line {
    /// Whether the first name is that of a hidden effect; false where nothing is named.
    pub fn first_is_right(&self) -> bool {
        self.named
            .first()
            .is_some_and(|named| self.hidden.iter().any(|truth| named.is(truth)))
    }

    /// Whether the names are those of the hidden effects, each once, and no more.
    pub fn is_exact(&self) -> bool {
        self.named.len() == self.hidden.len() && self.matched(&self.named, &mut Vec::new())
    }

    /// Whether each name can be given a hidden effect of its own, beside those `taken`.
    fn matched(&self, named: &[Named], taken: &mut Vec<usize>) -> bool {
        let Some((first, rest)) = named.split_first() else {
            return true;
        };
        for (k, truth) in self.hidden.iter().enumerate() {
            if !taken.contains(&k) && first.is(truth) {
                taken.push(k);
                if self.matched(rest, taken) {
                    return true;
                }
                taken.pop();
            }
        }
        false
    }

    /// Every name with whether it is right.
    pub fn judged(&self) -> impl Iterator<Item = (&Named, bool)> {
        self.named
            .iter()
            .map(|named| (named, self.hidden.iter().any(|truth| named.is(truth))))
    }

    /// Whether a name with a confidence above 0.9 is wrong.
    pub fn is_confidently_wrong(&self) -> bool {
        self.judged()
            .any(|(named, right)| !right && named.confidence > 0.9)
    }
}
