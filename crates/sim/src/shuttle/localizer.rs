//! The localization of the shuttle: scans that are matched against the map, and wheels that count.

use crate::machine::feed::Noise;
use crate::machine::route::Pose2d;

/// The largest error of a given position with which the scans still find the true one.
const FINDS_WITHIN_M: f64 = 5.0;
const FINDS_WITHIN_TURN: f64 = 0.6;
const FINDS_AFTER_MS: u64 = 1000;
/// Matching needs a few scans before its position is trusted again.
const SETTLE_MS: u64 = 200;
/// Without scans the position stays the same for so long, then none is published any more.
const GIVES_UP_AFTER_MS: u64 = 500;
pub(super) const JUMP_M: f64 = 1.2;
/// A position with three places that fit jumps from one to the next. Half a second ago it was always at another
/// one, also where messages come early or late by 150 ms.
const JUMP_EVERY_MS: u64 = 333;
/// The corners of a triangle with equal sides, ahead and to the left; the last one is the true place.
const JUMPS_M: [(f64, f64); 3] = [(0.0, JUMP_M), (0.866 * JUMP_M, JUMP_M / 2.0), (0.0, 0.0)];
/// The error of the wheels: unknown tyre pressure, an uneven road.
const WHEEL_ERROR: f64 = 1.003;
const YAW_ERROR: f64 = 1.002;

#[derive(Debug, Clone)]
pub(super) struct Localizer {
    knows: Knows,
    matching_since_ms: Option<u64>,
    /// When the position was last confirmed by a scan.
    pose_at_ms: u64,
    jumps_since_ms: Option<u64>,
    /// Without wheels it publishes nothing until it has matched again with them.
    silent: bool,
    /// Its estimate of the position.
    pub pose: Pose2d,
    /// The position by the wheels, from where they began to count.
    pub odometry: Pose2d,
    pub yaw_rate: f64,
    truth: Pose2d,
}

/// The state of the localization.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Knows {
    Nothing,
    /// A position was given.
    Hint {
        since_ms: u64,
        near: bool,
    },
    Found,
}

/// The inputs that arrive in time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fed {
    pub scans: bool,
    pub wheels: bool,
}

/// Its own diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Match {
    NoPosition,
    Searches,
    FitsNowhere,
    Found,
}

impl Localizer {
    /// `located`: it knows its position from the start.
    pub fn new(truth: Pose2d, located: bool) -> Localizer {
        Localizer {
            knows: if located { Knows::Found } else { Knows::Nothing },
            matching_since_ms: None,
            pose_at_ms: 0,
            jumps_since_ms: None,
            silent: false,
            pose: truth,
            odometry: Pose2d::default(),
            yaw_rate: 0.0,
            truth,
        }
    }

    /// An operator gives the position.
    pub fn hint(&mut self, place: Pose2d, now_ms: u64) {
        let near = place.distance_m(self.truth) <= FINDS_WITHIN_M
            && place.turn_to(self.truth).abs() <= FINDS_WITHIN_TURN;
        self.knows = Knows::Hint { since_ms: now_ms, near };
    }

    pub fn step(&mut self, now_ms: u64, truth: Pose2d, fed: Fed, jumps: bool, noise: &mut Noise) {
        self.truth = truth;
        self.silent |= !fed.wheels;
        if !jumps {
            self.jumps_since_ms = None;
        } else if self.jumps_since_ms.is_none() {
            self.jumps_since_ms = Some(now_ms);
        }
        if let Knows::Hint { since_ms, near: true } = self.knows
            && now_ms - since_ms >= FINDS_AFTER_MS
        {
            self.knows = Knows::Found;
        }
        if !(fed.scans && fed.wheels) || self.knows != Knows::Found {
            self.matching_since_ms = None;
            return;
        }
        let since_ms = *self.matching_since_ms.get_or_insert(now_ms);
        if now_ms - since_ms >= SETTLE_MS {
            self.pose_at_ms = now_ms;
            self.silent = false;
            let place = |since_ms| JUMPS_M[((now_ms - since_ms) / JUMP_EVERY_MS % 3) as usize];
            let (ahead_m, left_m) = self.jumps_since_ms.map_or((0.0, 0.0), place);
            let (ahead_m, left_m) = (ahead_m + noise.around(0.015), left_m + noise.around(0.015));
            self.pose = truth.moved(ahead_m, left_m, noise.around(0.001));
        }
    }

    /// A frame of the wheels, after this movement and turn.
    pub fn count(&mut self, moved_m: f64, turn: f64, step_s: f64, noise: &mut Noise) {
        self.yaw_rate = turn / step_s;
        let slip = if moved_m > 0.0 { noise.around(0.0005) } else { 0.0 };
        self.odometry = self.odometry.moved(moved_m * WHEEL_ERROR + slip, 0.0, turn * YAW_ERROR);
    }

    pub fn pose_age_ms(&self, now_ms: u64) -> u64 {
        now_ms - self.pose_at_ms
    }

    /// Whether it publishes a position, good or not.
    pub fn publishes(&self, now_ms: u64) -> bool {
        self.knows == Knows::Found && !self.silent && self.pose_age_ms(now_ms) <= GIVES_UP_AFTER_MS
    }

    pub fn matches(&self, now_ms: u64) -> Match {
        match self.knows {
            Knows::Nothing => Match::NoPosition,
            Knows::Hint { since_ms, .. } if now_ms - since_ms <= FINDS_AFTER_MS => Match::Searches,
            Knows::Hint { .. } => Match::FitsNowhere,
            Knows::Found => Match::Found,
        }
    }
}
