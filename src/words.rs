//! Numbers as people read them.

/// A number of few digits as an axis shows it: with an exponent where it is very large or small.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{x:.2e}").replace(".00e", "e").replace("0e", "e");
    }
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// A number in two digits, without an exponent where it is neither large nor small.
pub fn two_digits(x: f64) -> String {
    number(format!("{x:.1e}").parse().unwrap_or(x))
}

/// A part of one in per cent, in two digits.
pub fn percent(part: f64) -> String {
    format!("{} %", two_digits(100.0 * part))
}
