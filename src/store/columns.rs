//! Values as columns hold them: integers, words, JSON. No SQL here.

use serde::Serialize;
use serde::de::value::{Error as WordError, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer};

use super::StoreError;

/// A count or a place as the database's integer. Nothing that is stored lies beyond its range, so that a number which does
/// is found nowhere.
pub(super) fn integer(number: impl TryInto<i64>) -> i64 {
    number.try_into().unwrap_or(i64::MAX)
}

pub(super) fn json<T: DeserializeOwned>(text: &str) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|e| StoreError::Damaged(e.to_string()))
}

pub(super) fn to_json(value: &impl Serialize) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|e| StoreError::Database(e.to_string()))
}

/// The word by which a state, kind, phase or type is known: the one in the interface.
pub(super) fn word(value: &impl Serialize) -> Result<String, StoreError> {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(word)) => Ok(word),
        other => Err(StoreError::Database(format!("not a word: {other:?}"))),
    }
}

pub(super) fn from_word<T: DeserializeOwned>(word: &str) -> Result<T, StoreError> {
    let word: StrDeserializer<'_, WordError> = word.into_deserializer();
    T::deserialize(word).map_err(|e| StoreError::Damaged(e.to_string()))
}

pub(super) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        // Writing into a string cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::super::JobState;
    use super::*;
    use crate::analysis::JobKind;
    use crate::cloud::ScalarType;
    use crate::progress::Phase;

    #[test]
    fn words_of_the_interface_come_back_as_what_they_name() {
        assert_eq!(word(&JobState::Succeeded).unwrap(), "succeeded");
        assert_eq!(from_word::<JobState>("succeeded").unwrap(), JobState::Succeeded);
        assert_eq!(from_word::<JobKind>(&word(&JobKind::Eigen).unwrap()).unwrap(), JobKind::Eigen);
        assert_eq!(from_word::<ScalarType>(&word(&ScalarType::Uint8).unwrap()).unwrap(), ScalarType::Uint8);
        for phase in Phase::ALL {
            assert_eq!(from_word::<Phase>(phase.name()).unwrap(), phase);
        }
    }

    #[test]
    fn an_unknown_word_is_damage() {
        assert!(matches!(from_word::<JobState>("lost"), Err(StoreError::Damaged(_))));
    }

    #[test]
    fn digests_are_shown_with_two_lowercase_digits_per_byte() {
        assert_eq!(hex(&[0x00, 0x0a, 0xff]), "000aff");
    }
}
