//! Number formatting for readers.

/// A number with few digits, as on a chart axis; with an exponent if very large or small.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{x:.2e}").replace(".00e", "e").replace("0e", "e");
    }
    // Four decimals, or as many as give four significant digits.
    let decimals = if (1e-3..0.1).contains(&size) { (3.0 - size.log10().floor()) as usize } else { 4 };
    let text = format!("{x:.decimals$}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// A number with two significant digits, without an exponent if it is neither large nor small.
pub fn two_digits(x: f64) -> String {
    number(format!("{x:.1e}").parse().unwrap_or(x))
}

/// A fraction as a percentage with two significant digits.
pub fn percent(part: f64) -> String {
    format!("{} %", two_digits(100.0 * part))
}

/// A number with `digits` significant digits, with an exponent if very large or small; zero has no sign.
pub fn significant(x: f64, digits: usize) -> String {
    let size = x.abs();
    if size == 0.0 {
        return "0".to_string();
    }
    if !(1e-3..1e5).contains(&size) {
        return format!("{x:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - size.log10().floor() as i32).max(0) as usize;
    format!("{x:.decimals$}")
}

/// A number for sentences and text tables: at most `digits` significant digits, no trailing zeros, and any exponent as a power of
/// ten.
pub fn in_sentence(x: f64, digits: usize) -> String {
    let text = significant(x, digits);
    let (digits, power) = text.split_once('e').unwrap_or((&text, ""));
    let digits = if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { digits };
    power.parse().map_or_else(|_| digits.to_string(), |power| format!("{digits}·10{}", superscript(power)))
}

/// Units that stay on the line of their number.
const UNITS: [&str; 21] = [
    "%", "m", "mm", "µm", "s", "ms", "Hz", "rad", "N", "J", "W", "Pa", "kg", "1/s", "1/m", "m/s", "rad/s", "N/m",
    "N·m", "kg/m³", "px",
];

/// Typesets a text for pages: exponents as powers of ten, true minus signs, and no line break between a number and its unit. What
/// follows an equals sign stays as written in a scene.
pub fn typeset(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    let (mut measured, mut assigned, mut lists) = (false, false, false);
    for (i, word) in text.split(' ').enumerate() {
        let bare = word.trim_end_matches([',', '.', ';', ':', ')']);
        let is_unit = UNITS.contains(&bare);
        if i > 0 {
            out.push(if measured && is_unit { '\u{a0}' } else { ' ' });
        }
        let opened = bare.trim_start_matches('(');
        let digits = opened.trim_start_matches(['-', '+']);
        let is_number = digits.starts_with(|c: char| c.is_ascii_digit()) && digits.ends_with(|c: char| c.is_numeric());
        if is_number && !assigned {
            out += &word[..bare.len() - opened.len()];
            out += &typeset_number(opened);
            out += &word[bare.len()..];
        } else {
            out += word;
        }
        // In N m, the second unit also belongs to the number.
        measured = bare.len() == word.len() && (is_number || measured && is_unit);
        // Values of a key are as they were written, also the others of a list.
        lists |= word == "=";
        assigned = word == "=" || lists && word == "|" || assigned && word.is_empty();
    }
    out
}

/// A number with its exponent as a power of ten and a true minus sign.
fn typeset_number(text: &str) -> String {
    let power = text.split_once('e').and_then(|(digits, power)| Some((digits, power.parse().ok()?)));
    let text = match power {
        Some((digits, power)) if digits.parse::<f64>().is_ok() => format!("{digits}·10{}", superscript(power)),
        _ => text.to_string(),
    };
    text.strip_prefix('-').map_or(text.clone(), |size| format!("−{size}"))
}

/// An integer as superscript digits.
pub fn superscript(power: i32) -> String {
    let raised = |c: char| match c.to_digit(10) {
        Some(digit) => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize],
        None => '⁻',
    };
    power.to_string().chars().map(raised).collect()
}

/// A number with sign and `decimals` decimals; a value that rounds to zero has no sign.
pub fn signed(x: f64, decimals: usize) -> String {
    let text = format!("{x:+.decimals$}");
    if text.bytes().any(|digit| (b'1'..=b'9').contains(&digit)) || !x.is_finite() {
        text
    } else {
        text[1..].to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_parts_no_number_from_its_unit_and_has_one_way_to_write_exponents() {
        let slip = typeset("slip -6.461e-11, 26 % of 0.1 N m, (-2 m) and 1e-3.");
        assert_eq!(slip, "slip −6.461·10⁻¹¹, 26\u{a0}% of 0.1\u{a0}N\u{a0}m, (−2\u{a0}m) and 1·10⁻³.");
        for text in [
            "solver.time_step_s = 1e-3, case 3 stays, 2e, well-known 5-eyed m",
            "2 keys differ: rod.youngs_modulus_pa = 5e5 | 1e6; solver.time_step_s = not given | 1e-3.",
        ] {
            assert_eq!(typeset(text), text);
        }
    }

    #[test]
    fn a_sentence_has_powers_of_ten_and_no_needless_zeros() {
        let numbers = [0.7588, 13.77, 2e-2, 4.2e-8, -1.5e7, 0.0, 1200.0].map(|x| in_sentence(x, 4));
        assert_eq!(numbers, ["0.7588", "13.77", "0.02", "4.2·10⁻⁸", "-1.5·10⁷", "0", "1200"]);
    }
}
