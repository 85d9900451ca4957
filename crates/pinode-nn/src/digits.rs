//! Numbers with as many digits as they deserve.

/// Three significant digits.
pub fn number(x: f64) -> String {
    if x.is_nan() {
        return "–".to_owned();
    }
    if x.is_infinite() {
        return if x > 0.0 { "∞" } else { "-∞" }.to_owned();
    }
    if x == 0.0 {
        return "0".to_owned();
    }
    let exponent = exponent(x, 2);
    if is_plain(exponent) {
        fixed(x, 2 - exponent)
    } else {
        format!("{}{}", fixed(x / 10f64.powi(exponent), 2), power(exponent))
    }
}

/// A number without zeros at its end, for what was set and not measured.
pub fn short(x: f64) -> String {
    let number = number(x);
    match number.contains('.') && !number.contains('×') {
        true => number
            .trim_end_matches('0')
            .trim_end_matches('.')
            .to_owned(),
        false => number,
    }
}

/// A value with its standard error, both to the second digit of the error: `0.312 ± 0.010`. Without one, three digits.
pub fn uncertain(value: f64, std: Option<f64>) -> String {
    let Some(std) = std.filter(|s| s.is_finite() && *s > 0.0) else {
        return number(value);
    };
    if !value.is_finite() {
        return number(value);
    }
    let size = exponent(value.abs().max(std), 2);
    // At most six digits, however small the error.
    let last = (exponent(std, 1) - 1).max(size - 5);
    if is_plain(size) {
        format!("{} ± {}", fixed(value, -last), fixed(std, -last))
    } else {
        let scale = 10f64.powi(size);
        let decimals = size - last;
        let (value, std) = (fixed(value / scale, decimals), fixed(std / scale, decimals));
        format!("({value} ± {std}){}", power(size))
    }
}

/// Power of ten of `x` rounded to `digits` decimals of its mantissa; 0 for 0.
pub fn exponent(x: f64, digits: usize) -> i32 {
    let scientific = format!("{x:.digits$e}");
    let exponent = scientific.split('e').nth(1);
    exponent.and_then(|e| e.parse().ok()).unwrap_or(0)
}

/// Whether a number of this size is written out.
pub fn is_plain(exponent: i32) -> bool {
    (-3..6).contains(&exponent)
}

/// So many decimals; none below 0.
pub fn fixed(x: f64, decimals: i32) -> String {
    format!("{x:.*}", usize::try_from(decimals).unwrap_or(0))
}

/// `×10⁻⁵`.
pub fn power(exponent: i32) -> String {
    let digits = exponent.to_string();
    let raised = digits.chars().map(|c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '4' => '⁴',
        '5' => '⁵',
        '6' => '⁶',
        '7' => '⁷',
        '8' => '⁸',
        '9' => '⁹',
        _ => '⁰',
    });
    "×10".chars().chain(raised).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        assert_eq!(number(0.314159), "0.314");
        assert_eq!(number(9.999), "10.0");
        assert_eq!(number(-12.34), "-12.3");
        assert_eq!(number(123456.0), "123456");
        assert_eq!(number(1.234e-5), "1.23×10⁻⁵");
        assert_eq!(number(0.0), "0");
        assert_eq!(number(f64::NAN), "–");
        assert_eq!(number(f64::INFINITY), "∞");
    }

    #[test]
    fn what_was_set_has_no_zeros_at_its_end() {
        assert_eq!(
            (short(0.6), short(2.0), short(200.0)),
            ("0.6".into(), "2".into(), "200".into())
        );
    }
}
