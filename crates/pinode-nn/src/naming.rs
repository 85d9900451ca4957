//! Names in messages: quoted, bounded in length, with the nearest valid one.

/// Longer names are cut in messages and not compared.
const LONGEST: usize = 60;

/// `name` between backquotes; control characters escaped, long ones cut.
pub(crate) fn quoted(name: &str) -> String {
    let mut out = String::from("`");
    for (count, c) in name.chars().enumerate() {
        if count == LONGEST {
            out.push('…');
            break;
        }
        if c.is_control() {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    out.push('`');
    out
}

/// The candidate with the smallest edit distance to `name`; one of which `name` is a word, as `viscous` of `viscous_friction`, is as near as one
/// that is two edits away.
pub(crate) fn nearest<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let short: String = name
        .chars()
        .take(LONGEST)
        .collect::<String>()
        .to_lowercase();
    candidates.into_iter().min_by_key(|candidate| {
        let candidate = candidate.to_lowercase();
        let edits = strsim::osa_distance(&short, &candidate);
        match candidate.split(['_', '.']).any(|word| word == short) {
            true => (edits.min(2), edits),
            false => (edits, edits),
        }
    })
}

/// `; nearest: x`, and all candidates when they are few; says so when there are none.
pub(crate) fn hint(name: &str, what: &str, candidates: &[&str]) -> String {
    match (nearest(name, candidates.iter().copied()), candidates.len()) {
        (None, _) => format!("; there are no {what}"),
        (Some(only), 1) => format!("; {what}: {}", quoted(only)),
        (Some(best), 2..=8) => format!(
            "; nearest: {} ({what}: {})",
            quoted(best),
            candidates.join(", ")
        ),
        (Some(best), _) => format!("; nearest: {}", quoted(best)),
    }
}

/// A thing in a sentence: a name in quotes stands without an article.
pub(crate) fn with_article(thing: &str) -> String {
    let article = if thing.starts_with('`') { "" } else { "the " };
    format!("{article}{thing}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_with_fewest_edits() {
        assert_eq!(nearest("silder", ["pole", "slider"]), Some("slider"));
        assert_eq!(nearest("Pole", ["pole", "slider"]), Some("pole"));
        assert_eq!(nearest("x", []), None);
        let kinds = ["payload", "asymmetric_viscous_friction", "viscous_friction"];
        assert_eq!(nearest("viscous", kinds), Some("viscous_friction"));
        assert_eq!(nearest("palyoad", kinds), Some("payload"));
    }

    #[test]
    fn quoted_names_are_bounded_and_on_one_line() {
        assert_eq!(quoted("a\nb"), "`a\\nb`");
        assert!(quoted(&"x".repeat(10_000)).len() < 80);
    }
}
