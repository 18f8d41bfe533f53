//! Number of diffuse bounces of light.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Number of diffuse bounces of light beyond direct light. In files and on the command line a
/// number, or `full`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Bounces {
    /// All bounces.
    Full,
    /// Exactly this many.
    #[serde(untagged)]
    Exactly(u32),
}

impl Bounces {
    /// Maximum number of bounces on the command line.
    pub const MAX: u32 = 64;
}

impl From<u32> for Bounces {
    fn from(number: u32) -> Self {
        Self::Exactly(number)
    }
}

impl fmt::Display for Bounces {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Full => f.write_str("full"),
            Self::Exactly(number) => number.fmt(f),
        }
    }
}

impl FromStr for Bounces {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "full" {
            return Ok(Self::Full);
        }
        text.parse()
            .ok()
            .filter(|number| *number <= Self::MAX)
            .map(Self::Exactly)
            .ok_or_else(|| format!("give a number from 0 to {}, or full", Self::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_json_round_trip() {
        for (bounces, text, json) in [
            (Bounces::Full, "full", "\"full\""),
            (Bounces::Exactly(0), "0", "0"),
            (Bounces::Exactly(64), "64", "64"),
        ] {
            assert_eq!(text.parse(), Ok(bounces));
            assert_eq!(bounces.to_string(), text);
            assert_eq!(serde_json::to_string(&bounces).expect("JSON"), json);
            assert_eq!(
                serde_json::from_str::<Bounces>(json).expect("JSON"),
                bounces
            );
        }
        for wrong in ["", "all", "-1", "65", "1.5"] {
            assert!(wrong.parse::<Bounces>().is_err(), "{wrong}");
        }
        for wrong in ["\"all\"", "-1", "null", "1.5"] {
            assert!(serde_json::from_str::<Bounces>(wrong).is_err(), "{wrong}");
        }
    }
}
