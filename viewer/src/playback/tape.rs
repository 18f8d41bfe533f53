//! Recording and replaying a path, as a state machine without clock or window.

use crate::input::pose::Pose;
use crate::playback::eye_path::{CameraPath, Recorder};

/// Replay mode of a path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReplayMode {
    /// At the speed of its times; frames that are not ready in time are left out.
    #[default]
    InTime,
    /// Every pose of the path is shown once, however long its frame takes.
    EveryPose,
}

/// The path in hand, and what is done with it.
#[derive(Clone, Debug, Default)]
pub(crate) struct PathRecorder {
    pub path: Option<CameraPath>,
    pub mode: ReplayMode,
    /// Start again at the end.
    pub repeat: bool,
    recorder: Option<Recorder>,
    playback: Option<Playback>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Playback {
    InTime { started_s: f64 },
    EveryPose { index: usize },
}

/// Request of a replay to the window in this pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Replay {
    /// Nothing is replayed.
    Idle,
    /// Show this pose.
    Show(Pose),
    /// Show this last pose; the replay is over.
    Ended(Pose),
}

impl PathRecorder {
    /// Without a path yet.
    pub(crate) fn new(mode: ReplayMode) -> Self {
        Self {
            mode,
            ..Self::default()
        }
    }

    /// Number of poses recorded so far, while recording.
    pub(crate) fn recorded(&self) -> Option<usize> {
        self.recorder.as_ref().map(Recorder::len)
    }

    pub(crate) fn is_playing(&self) -> bool {
        self.playback.is_some()
    }

    /// Index of the pose waiting to be shown, if every pose is to be shown: its frame must be
    /// rendered although the pose may equal the one before.
    pub(crate) fn pose_index(&self) -> Option<usize> {
        match self.playback {
            Some(Playback::EveryPose { index }) => Some(index),
            _ => None,
        }
    }

    /// Share of the path that has been replayed.
    pub(crate) fn progress(&self, now_s: f64) -> Option<f64> {
        let path = self.path.as_ref()?;
        Some(match self.playback? {
            Playback::InTime { started_s } => {
                ((now_s - started_s) / path.duration_s().max(1e-9)).clamp(0.0, 1.0)
            }
            Playback::EveryPose { index } => index as f64 / path.poses().len() as f64,
        })
    }

    /// Begins to record (a replay ends).
    pub(crate) fn record(&mut self) {
        self.playback = None;
        self.recorder = Some(Recorder::default());
    }

    /// Notes the pose, if recording.
    pub(crate) fn note(&mut self, now_s: f64, pose: Pose) {
        if let Some(recorder) = &mut self.recorder {
            recorder.record(now_s, pose);
        }
    }

    /// Ends the recording; its path, if it holds anything, replaces the one in hand.
    pub(crate) fn stop_recording(&mut self) -> bool {
        let path = self.recorder.take().and_then(Recorder::finish);
        let kept = path.is_some();
        self.path = path.or(self.path.take());
        kept
    }

    /// Begins to replay from the start; false if there is no path.
    pub(crate) fn play(&mut self, now_s: f64) -> bool {
        self.stop_recording();
        self.playback = self.path.as_ref().map(|_| match self.mode {
            ReplayMode::InTime => Playback::InTime { started_s: now_s },
            ReplayMode::EveryPose => Playback::EveryPose { index: 0 },
        });
        self.is_playing()
    }

    pub(crate) fn stop(&mut self) {
        self.playback = None;
    }

    /// The pose to show at `now_s`.
    pub(crate) fn step(&mut self, now_s: f64) -> Replay {
        let (Some(path), Some(playback)) = (&self.path, self.playback) else {
            return Replay::Idle;
        };
        match playback {
            Playback::InTime { started_s } => {
                let time_s = now_s - started_s;
                if time_s < path.duration_s() {
                    return Replay::Show(path.at(time_s));
                }
                if self.repeat && path.duration_s() > 0.0 {
                    self.playback = Some(Playback::InTime { started_s: now_s });
                    return Replay::Show(path.at(0.0));
                }
                self.playback = None;
                Replay::Ended(path.at(path.duration_s()))
            }
            Playback::EveryPose { index } => match path.poses().get(index) {
                Some(pose) => Replay::Show(pose.pose),
                None if self.repeat => {
                    self.playback = Some(Playback::EveryPose { index: 0 });
                    Replay::Show(path.poses()[0].pose)
                }
                None => {
                    self.playback = None;
                    Replay::Ended(path.poses()[index - 1].pose)
                }
            },
        }
    }

    /// The frame of pose `index` ([`Self::pose_index`]) is on the screen: on to the next, if that
    /// was awaited.
    pub(crate) fn shown(&mut self, index: usize) {
        if self.pose_index() == Some(index) {
            self.playback = Some(Playback::EveryPose { index: index + 1 });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::playback::eye_path::TimedPose;
    use glam::DVec3;

    fn tape(mode: ReplayMode) -> PathRecorder {
        let pose = |i: u32| Pose {
            eye: DVec3::X * f64::from(i),
            yaw_rad: 0.0,
            pitch_rad: 0.0,
            fov_y_deg: 60.0,
            up: DVec3::Y,
        };
        let poses = (0..3)
            .map(|i| TimedPose {
                time_s: f64::from(i),
                pose: pose(i),
            })
            .collect();
        PathRecorder {
            path: CameraPath::new(poses).ok(),
            mode,
            ..PathRecorder::default()
        }
    }

    fn x(replay: Replay) -> f64 {
        match replay {
            Replay::Show(pose) | Replay::Ended(pose) => pose.eye.x,
            Replay::Idle => f64::NAN,
        }
    }

    #[test]
    fn in_time_follows_the_clock() {
        let mut tape = tape(ReplayMode::InTime);
        assert_eq!(tape.step(5.0), Replay::Idle);
        assert!(tape.play(10.0));
        assert_eq!(x(tape.step(10.0)), 0.0);
        assert!((x(tape.step(11.5)) - 1.5).abs() < 1e-9);
        tape.shown(0);
        assert!((tape.progress(11.0).unwrap() - 0.5).abs() < 1e-9);
        assert!(matches!(tape.step(12.5), Replay::Ended(pose) if pose.eye.x == 2.0));
        assert!(!tape.is_playing());
    }

    #[test]
    fn every_pose_waits_for_its_frame() {
        let mut tape = tape(ReplayMode::EveryPose);
        tape.play(0.0);
        for (i, pose) in [0.0, 1.0, 2.0].into_iter().enumerate() {
            assert_eq!(tape.pose_index(), Some(i));
            assert_eq!(x(tape.step(1000.0 * pose)), pose);
            assert_eq!(
                x(tape.step(1000.0 * pose + 1.0)),
                pose,
                "not before the frame was shown"
            );
            tape.shown(i);
            tape.shown(i);
        }
        assert!(matches!(tape.step(9e9), Replay::Ended(_)));
        assert_eq!(tape.step(9e9), Replay::Idle);
    }

    #[test]
    fn repeating_starts_again() {
        for mode in [ReplayMode::InTime, ReplayMode::EveryPose] {
            let mut tape = PathRecorder {
                repeat: true,
                ..tape(mode)
            };
            tape.play(0.0);
            (0..3).for_each(|i| tape.shown(i));
            assert_eq!(x(tape.step(2.5)), 0.0);
            assert!(tape.is_playing());
        }
    }

    #[test]
    fn an_empty_recording_keeps_the_old_path() {
        let mut tape = tape(ReplayMode::InTime);
        tape.record();
        assert_eq!(tape.recorded(), Some(0));
        assert!(!tape.stop_recording());
        assert_eq!(tape.path.as_ref().unwrap().poses().len(), 3);
        tape.record();
        let pose = tape.path.as_ref().unwrap().at(1.0);
        (0..10).for_each(|i| {
            tape.note(
                f64::from(i),
                Pose {
                    eye: DVec3::X * f64::from(i),
                    ..pose
                },
            );
        });
        assert!(tape.stop_recording());
        assert_eq!(tape.path.as_ref().unwrap().poses().len(), 10);
        assert!(!PathRecorder::default().play(0.0), "nothing to play");
    }
}
