//! What a file said beside its points.

use super::Survey;

/// Notes of the reader and the frame of a survey: kept with the cloud, so that it can be written as it came and whoever
/// works with it knows what was left out.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct Origin {
    /// What was left out, and what was not taken word for word; a sentence each.
    pub notes: Vec<String>,
    /// Header and records of the LAS file that the cloud came in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub survey: Option<Survey>,
}

impl Origin {
    /// Whether there is nothing to keep.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.notes.is_empty() && self.survey.is_none()
    }
}
