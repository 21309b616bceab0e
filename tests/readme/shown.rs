//! Compares the output that a page shows with the output of its command: numbers up to rounding, `…` for anything.

/// How far a shown number may be from the real one, relative to it: instruction sets round differently.
const RELATIVE: f64 = 1e-6;
/// Numbers below this are noise and compare as zero.
const NOISE: f64 = 1e-12;

/// A number, an id, or one other character.
#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Id,
    Other(char),
}

impl Token {
    fn matches(&self, real: &Self) -> bool {
        match (self, real) {
            (Self::Number(shown), Self::Number(real)) => {
                (shown - real).abs() <= RELATIVE * real.abs() || shown.abs().max(real.abs()) < NOISE
            }
            _ => self == real,
        }
    }
}

/// Splits text into tokens; blanks and line ends carry no meaning.
fn tokens(text: &str) -> Vec<Token> {
    let mut found = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let word =
            rest.find(|c: char| !c.is_ascii_alphanumeric() && !"+-._".contains(c)).unwrap_or(rest.len());
        let word = &rest[..word];
        let taken = if word.len() == 36 && word.matches('-').count() == 4 {
            found.push(Token::Id);
            word.len()
        } else if let (true, Ok(number)) = (first.is_ascii_digit() || first == '-', word.parse()) {
            found.push(Token::Number(number));
            word.len()
        } else {
            found.push(Token::Other(first));
            first.len_utf8()
        };
        rest = rest[taken..].trim_start();
    }
    found
}

/// Whether `real` begins with what `shown` has before its first `…`, and has the rest in this order.
pub(crate) fn agrees(shown: &str, real: &str) -> Result<(), String> {
    let real = tokens(real);
    let mut from = 0;
    for (place, part) in shown.split('…').enumerate() {
        let part = tokens(part);
        let fits = |start: &usize| {
            let tail = &real[*start..];
            tail.len() >= part.len() && part.iter().zip(tail).all(|(shown, real)| shown.matches(real))
        };
        let last = if place == 0 { 0 } else { real.len() };
        match (from..=last).find(fits) {
            Some(start) => from = start + part.len(),
            None => return Err(format!("part {place} of the shown output is not in the real one: {part:?}")),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::agrees;

    #[test]
    fn numbers_agree_up_to_rounding_and_nothing_else_does() {
        assert!(agrees("{\"a\":1.00000001,…", "{\"a\": 1.0, \"b\": 2}").is_ok());
        assert!(agrees("{\"a\":1.1,…", "{\"a\": 1.0, \"b\": 2}").is_err());
        assert!(agrees("… \"b\":2}", "{\"a\": 1.0, \"b\": 2}").is_ok());
        assert!(agrees("\"b\":2}", "{\"a\": 1.0, \"b\": 2}").is_err());
    }

    #[test]
    fn ids_agree_with_any_id() {
        let (shown, real) = ("01a202c1-ce91-760d-84e4-e2a9b12d08d9", "01a202c1-ce94-74e9-a1f0-64a67481b9d1");
        assert!(agrees(&format!("\"{shown}\""), &format!("\"{real}\"")).is_ok());
    }
}
