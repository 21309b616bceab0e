//! Spectral filters [PBMHB §5.4]: a transfer function on frequency multiplies the coefficients.
//!
//! `x' = Σ F(λ_i) x̃_i H_i + F_high · (x − Σ x̃_i H_i)`: with finitely many bases, what lies outside of their span is kept
//! apart. Its factor is what the filter does above all frequencies, unless the caller says otherwise.

use serde::Serialize;

use super::Modes;
use crate::arguments::{arguments, words};

words! {
    /// What a filter does.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum FilterKind {
        /// Keeps what lies below the cut-off.
        #[default]
        LowPass,
        /// Keeps what lies at or above the cut-off.
        HighPass,
        /// Keeps what lies between two edges.
        BandPass,
        /// Removes what lies between two edges.
        BandStop,
        /// Multiplies what lies between two edges, or from one on, by a gain.
        Enhance,
        /// Lets heat flow for a time: `exp(−sλ)`.
        Heat,
    }
}

words! {
    /// In what an edge is given.
    #[derive(Default)]
    #[non_exhaustive]
    pub enum Scale {
        /// Number of a mode, from 0.
        #[default]
        Mode,
        /// √λ, in 1/length.
        Frequency,
        /// 2π/√λ, in units of the cloud.
        Wavelength,
    }
}

arguments! {
    /// A filter as a caller describes it; what is absent has the kind's default.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Filter {
        /// What the filter does: `low-pass` keeps what lies below the cut-off, `high-pass` what lies above; `band-pass` keeps
        /// what lies between two edges, `band-stop` removes it, `enhance` multiplies it by a gain; `heat` smooths by
        /// exp(−sλ).
        #[name = "filter"]
        #[alias = "kind"]
        kind: FilterKind = word(FilterKind), default FilterKind::LowPass;
        /// In what edges are given: number of a mode, counting from 0; frequency √λ in 1/length; or wavelength 2π/√λ in
        /// units of the cloud.
        #[alias = "unit"]
        by: Scale = word(Scale), default Scale::Mode;
        /// The edge of low-pass and high-pass: what lies at it is above it. For heat, where the gain has fallen to 1/e.
        cutoff: Option<f64> = nonnegative, absent "the whole span of the bases";
        /// Lower edge of a band, itself inside. Of two wavelengths, the longer one.
        from: Option<f64> = nonnegative, absent "the lowest mode";
        /// Upper edge of a band, itself outside.
        to: Option<f64> = nonnegative, absent "no upper edge";
        /// Factor on the band of `enhance`.
        gain: Option<f64> = nonnegative, absent "2";
        /// Time s of `heat`, in squared units of the cloud.
        time: Option<f64> = nonnegative, absent "from cutoff";
        /// Width of the transition around every edge, as a share of its frequency, against ringing.
        taper: f64 = range(0.0, 1.0), default 0.0;
        /// Factor on what lies outside of the span of the bases: 0 drops it, 1 keeps it.
        outside: Option<f64> = nonnegative, absent "what the filter does at the highest frequencies";
    }
}

/// A filter on given modes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
#[non_exhaustive]
pub struct Transfer {
    /// Factor of every mode.
    pub gains: Vec<f64>,
    /// Factor on what lies outside of the span of the bases.
    pub outside: f64,
}

/// A parameter that makes no filter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("parameter `{parameter}` {reason}")]
#[non_exhaustive]
pub struct FilterError {
    /// As in the interface.
    pub parameter: &'static str,
    /// What is wrong, and what would be accepted.
    pub reason: String,
}

fn refuse<T>(parameter: &'static str, reason: impl Into<String>) -> Result<T, FilterError> {
    Err(FilterError { parameter, reason: reason.into() })
}

/// Gain of [`FilterKind::Enhance`] when none is given.
pub const GAIN_DEFAULT: f64 = 2.0;

impl Filter {
    /// The factor of every mode.
    ///
    /// # Errors
    /// [`FilterError`] for arguments that the kind does not take or lacks, and for edges beyond the bases, of which
    /// nothing is known, unless the caller says what happens outside of them.
    pub fn transfer(&self, modes: &Modes) -> Result<Transfer, FilterError> {
        self.check_arguments()?;
        let k = modes.len();
        let edge = |name, value: Option<f64>| value.map(|value| self.edge(name, value, modes)).transpose();
        let (gains, limit): (Vec<f64>, f64) = match self.kind {
            FilterKind::LowPass => {
                let edge = edge("cutoff", self.cutoff)?;
                ((0..k).map(|i| edge.map_or(1.0, |edge| 1.0 - edge.above(i, modes))).collect(), 0.0)
            }
            FilterKind::HighPass => {
                let edge = edge("cutoff", self.cutoff)?;
                ((0..k).map(|i| edge.map_or(0.0, |edge| edge.above(i, modes))).collect(), 1.0)
            }
            FilterKind::BandPass => (self.band(modes)?, 0.0),
            FilterKind::BandStop => (self.band(modes)?.iter().map(|inside| 1.0 - inside).collect(), 1.0),
            FilterKind::Enhance => {
                let gain = self.gain.unwrap_or(GAIN_DEFAULT);
                let gains = self.band(modes)?.iter().map(|inside| 1.0 + (gain - 1.0) * inside).collect();
                (gains, if self.to.is_none() { gain } else { 1.0 })
            }
            FilterKind::Heat => {
                let time = match (self.time, edge("cutoff", self.cutoff)?) {
                    (Some(time), _) => time,
                    (None, Some(edge)) if edge.frequency == 0.0 => {
                        return refuse("cutoff", "lies at frequency 0; heat needs one above");
                    }
                    // at the cut-off the gain is 1/e
                    (None, Some(edge)) => edge.frequency.powi(-2),
                    (None, None) => return refuse("time", "or `cutoff` is needed for the heat filter"),
                };
                let gain = |&lambda: &f64| if lambda.is_finite() { (-time * lambda).exp() } else { 0.0 };
                (modes.eigenvalues().iter().map(gain).collect(), 0.0)
            }
        };
        Ok(Transfer { gains, outside: self.outside.unwrap_or(limit) })
    }

    /// What was asked for, in words.
    #[must_use]
    pub fn describe(&self) -> String {
        let given = [
            ("cutoff", self.cutoff),
            ("from", self.from),
            ("to", self.to),
            ("gain", self.gain),
            ("time", self.time),
            ("taper", Some(self.taper).filter(|&taper| taper > 0.0)),
        ];
        let given = given.iter().filter_map(|(name, value)| value.map(|value| format!(", {name} {value}")));
        let scale = if self.by == Scale::Mode { String::new() } else { format!(" by {}", self.by.name()) };
        format!("{}{scale}{}", self.kind.name(), given.collect::<String>())
    }

    /// Refuses numbers that mean nothing, and arguments that the kind does not look at.
    fn check_arguments(&self) -> Result<(), FilterError> {
        use FilterKind as F;
        let takes: [(&'static str, Option<f64>, &[F]); 5] = [
            ("cutoff", self.cutoff, &[F::LowPass, F::HighPass, F::Heat]),
            ("from", self.from, &[F::BandPass, F::BandStop, F::Enhance]),
            ("to", self.to, &[F::BandPass, F::BandStop, F::Enhance]),
            ("gain", self.gain, &[F::Enhance]),
            ("time", self.time, &[F::Heat]),
        ];
        for (name, value, kinds) in takes {
            let Some(value) = value else { continue };
            if !kinds.contains(&self.kind) {
                let kinds: Vec<_> = kinds.iter().map(|kind| kind.name()).collect();
                let reason =
                    format!("means nothing to {}; it belongs to {}", self.kind.name(), kinds.join(", "));
                return refuse(name, reason);
            }
            if !value.is_finite() || value < 0.0 {
                return refuse(name, format!("is a number from 0, not {value}"));
            }
        }
        if self.cutoff.is_some() && self.time.is_some() {
            return refuse("time", "cannot be combined with `cutoff`");
        }
        if !(0.0..=1.0).contains(&self.taper) {
            return refuse("taper", format!("is a number from 0 to 1, not {}", self.taper));
        }
        if self.outside.is_some_and(|outside| !outside.is_finite()) {
            return refuse("outside", "is a finite number");
        }
        Ok(())
    }

    /// How far inside of the band every mode lies, 0 to 1.
    fn band(&self, modes: &Modes) -> Result<Vec<f64>, FilterError> {
        let (from, to) = match (self.from, self.to) {
            (None, None) => return refuse("from", "or `to` is needed to say where the band lies"),
            // of two wavelengths the longer is the lower edge, in whichever order they come
            (Some(from), Some(to)) if self.by == Scale::Wavelength && from < to => (Some(to), Some(from)),
            (from, to) => (from, to),
        };
        let lower = from.map(|from| self.edge("from", from, modes)).transpose()?;
        let upper = to.map(|to| self.edge("to", to, modes)).transpose()?;
        if let (Some(lower), Some(upper)) = (&lower, &upper)
            && lower.frequency >= upper.frequency
            && lower.first >= upper.first
        {
            return refuse("to", "must lie above `from`");
        }
        let above =
            |edge: &Option<Edge>, i, otherwise| edge.as_ref().map_or(otherwise, |edge| edge.above(i, modes));
        Ok((0..modes.len()).map(|i| above(&lower, i, 1.0) * (1.0 - above(&upper, i, 0.0))).collect())
    }

    /// Where an edge lies among the modes.
    fn edge(&self, name: &'static str, value: f64, modes: &Modes) -> Result<Edge, FilterError> {
        let k = modes.len();
        let last = if k == 0 { 0.0 } else { modes.frequency(k - 1) };
        let known = modes.informative().end;
        let reach = if known == 0 { 0.0 } else { modes.frequency(known - 1) };
        let (first, frequency) = match self.by {
            Scale::Mode => {
                if value > k as f64 || value.fract() != 0.0 {
                    return refuse(name, format!("must be a whole mode number from 0 to {k}, not {value}"));
                }
                let first = value as usize;
                let at = |i: usize| modes.frequency(i.min(k - 1));
                let frequency = if first == 0 { 0.0 } else { f64::midpoint(at(first - 1), at(first)) };
                (first, frequency)
            }
            Scale::Frequency => (modes.below(value), value),
            Scale::Wavelength if value == 0.0 => return refuse(name, "must be a wavelength above 0"),
            Scale::Wavelength => {
                let frequency = std::f64::consts::TAU / value;
                (modes.below(frequency), frequency)
            }
        };
        if self.by != Scale::Mode && frequency > reach && self.outside.is_none() {
            return refuse(
                name,
                format!(
                    "lies beyond the {k} bases, which reach frequency {last:.6} (wavelength {:.6}): ask for more \
                     bases, or set `outside` to choose what happens to the rest",
                    std::f64::consts::TAU / last
                ),
            );
        }
        Ok(Edge { first, frequency, taper: self.taper })
    }
}

/// Where something begins among the modes.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// First mode at or above it.
    first: usize,
    /// Its frequency.
    frequency: f64,
    taper: f64,
}

impl Edge {
    /// How far above the edge a mode lies: 0 below, 1 above, in between along half a cosine in frequency.
    fn above(&self, mode: usize, modes: &Modes) -> f64 {
        let width = self.taper * self.frequency;
        if width == 0.0 {
            return f64::from(u8::from(mode >= self.first));
        }
        let place = ((modes.frequency(mode) - self.frequency) / width + 0.5).clamp(0.0, 1.0);
        0.5 - 0.5 * (std::f64::consts::PI * place).cos()
    }
}

impl Transfer {
    /// How many modes, from the first on, it takes to apply this: those behind are treated as what lies outside. At least
    /// one, which tells the rows without a result.
    #[must_use]
    pub fn reach(&self) -> usize {
        let last = self.gains.iter().rposition(|gain| gain.to_bits() != self.outside.to_bits());
        last.map_or(1, |last| last + 1)
    }

    /// From a list of gains; modes behind its end are treated as what lies outside.
    ///
    /// # Errors
    /// [`FilterError`] for more gains than modes, and numbers that are not finite.
    pub fn from_gains(mut gains: Vec<f64>, outside: f64, modes: &Modes) -> Result<Self, FilterError> {
        if gains.len() > modes.len() {
            return refuse("gains", format!("has {} numbers; there are {} bases", gains.len(), modes.len()));
        }
        if let Some(i) = gains.iter().position(|gain| !gain.is_finite()) {
            return refuse("gains", format!("has a number that is not finite at {i}"));
        }
        gains.resize(modes.len(), outside);
        Ok(Self { gains, outside })
    }

    /// The coefficients whose synthesis, added to `outside · f`, is the filtered function:
    /// `x' = Σ (F_i − F_high) x̃_i H_i + F_high x`.
    #[must_use]
    pub fn apply(&self, coefficients: &[f64]) -> Vec<f64> {
        coefficients.iter().zip(&self.gains).map(|(c, gain)| (gain - self.outside) * c).collect()
    }

    /// The coefficients of the filtered function.
    #[must_use]
    pub fn filtered(&self, coefficients: &[f64]) -> Vec<f64> {
        coefficients.iter().zip(&self.gains).map(|(c, gain)| gain * c).collect()
    }
}
