//! Exposure as specified by the user.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Largest absolute number of stops; beyond it, an exposure must be a mistake.
const MAX_STOPS: f32 = 40.0;

/// Exposure of a scene. Written `auto`, `auto+1`, `auto-0.5`, or as a number of stops.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Exposure {
    /// Metered, plus this many stops.
    Auto(f32),
    /// Linear radiance is multiplied by 2 to this power.
    Stops(f32),
}

impl Default for Exposure {
    fn default() -> Self {
        Self::Auto(0.0)
    }
}

impl Exposure {
    /// Returns the factor of linear radiance, given the metered factor `measured`.
    pub fn factor(self, measured: f32) -> f32 {
        match self {
            Self::Auto(stops) => measured * stops.exp2(),
            Self::Stops(stops) => stops.exp2(),
        }
    }
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto(stops) if *stops == 0.0 => f.write_str("auto"),
            Self::Auto(stops) => write!(f, "auto{stops:+}"),
            Self::Stops(stops) => write!(f, "{stops}"),
        }
    }
}

impl FromStr for Exposure {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let stops = |text: &str| {
            text.parse::<f32>()
                .ok()
                .filter(|stops| stops.abs() <= MAX_STOPS)
        };
        let parsed = match text.strip_prefix("auto") {
            Some("") => Some(Self::default()),
            Some(more) if more.starts_with(['+', '-']) => stops(more).map(Self::Auto),
            Some(_) => None,
            None => stops(text).map(Self::Stops),
        };
        parsed.ok_or_else(|| {
            format!(
                "give auto, auto+1 or auto-0.5, or a number of stops from -{MAX_STOPS} to {MAX_STOPS}"
            )
        })
    }
}

impl TryFrom<String> for Exposure {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Exposure> for String {
    fn from(exposure: Exposure) -> Self {
        exposure.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        for exposure in [
            Exposure::Auto(0.0),
            Exposure::Auto(1.5),
            Exposure::Auto(-0.25),
            Exposure::Stops(-3.5),
        ] {
            assert_eq!(exposure.to_string().parse(), Ok(exposure));
        }
        for wrong in [
            "",
            "auto1",
            "auto+",
            "nan",
            "inf",
            "41",
            "-41",
            "1e9",
            "automatic",
        ] {
            assert!(wrong.parse::<Exposure>().is_err(), "{wrong}");
        }
        assert_eq!(
            (
                Exposure::Auto(1.0).factor(0.3),
                Exposure::Stops(-2.0).factor(0.3)
            ),
            (0.6, 0.25)
        );
    }
}
