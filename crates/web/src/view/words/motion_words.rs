//! The texts of the vehicle's motion.

use super::{Lang, words};

words! {
    MotionWords;
    driving: "Driving", "Fährt";
    slowing: "Slowing down", "Bremst";
    stopping: "Stopping", "Hält an";
    standing: "Standing", "Steht";
    moving: "Moving", "In Bewegung";
    unknown: "Speed unknown", "Geschwindigkeit unbekannt";
    no_signal: "No speed signal", "Kein Tempo-Signal";
    next: "next", "Ziel";
}

impl Lang {
    pub fn motion(self) -> &'static MotionWords {
        match self {
            Lang::En => &EN,
            Lang::De => &DE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_motion_is_said_in_both_languages() {
        for (key, en, de) in ALL {
            assert!(!en.trim().is_empty() && !de.trim().is_empty() && en != de, "{key}: {en}");
        }
    }
}
