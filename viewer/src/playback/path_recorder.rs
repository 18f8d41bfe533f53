//! Recording and replay of a path, as a state machine without clock or window.

use crate::input::pose::Pose;
use crate::playback::eye_path::{CameraPath, Recorder};

/// Replay mode of a path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReplayMode {
    /// Replays at the speed of the path's times; late frames are skipped.
    #[default]
    InTime,
    /// Shows every pose of the path once, however long its frame takes.
    EveryPose,
}

/// Current path, and the state of its recording or replay.
#[derive(Clone, Debug, Default)]
pub(crate) struct PathRecorder {
    pub path: Option<CameraPath>,
    pub mode: ReplayMode,
    /// Restart at the end of a replay.
    pub repeat: bool,
    recorder: Option<Recorder>,
    playback: Option<Playback>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Playback {
    InTime { started_s: f64 },
    EveryPose { index: usize },
}

/// Pose of a replay in this pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Replay {
    /// No replay is running.
    Idle,
    /// Pose to show.
    LumigraphOverlay(Pose),
    /// Last pose to show; the replay is over.
    Ended(Pose),
}

impl PathRecorder {
    /// Creates a recorder without a path.
    pub(crate) fn new(mode: ReplayMode) -> Self {
        Self {
            mode,
            ..Self::default()
        }
    }

    /// Number of poses recorded so far; `None` if not recording.
    pub(crate) fn recorded(&self) -> Option<usize> {
        self.recorder.as_ref().map(Recorder::len)
    }

    pub(crate) fn is_playing(&self) -> bool {
        self.playback.is_some()
    }

    /// Index of the pose to show next in mode [`ReplayMode::EveryPose`]: its frame must be rendered
    /// even if the pose equals the previous one.
    pub(crate) fn pose_index(&self) -> Option<usize> {
        match self.playback {
            Some(Playback::EveryPose { index }) => Some(index),
            _ => None,
        }
    }

    /// Share of the path that has been replayed, 0 to 1; `None` if not replaying.
    pub(crate) fn progress(&self, now_s: f64) -> Option<f64> {
        let path = self.path.as_ref()?;
        Some(match self.playback? {
            Playback::InTime { started_s } => {
                ((now_s - started_s) / path.duration_s().max(1e-9)).clamp(0.0, 1.0)
            }
            Playback::EveryPose { index } => index as f64 / path.poses().len() as f64,
        })
    }

    /// Starts recording; ends a replay.
    pub(crate) fn record(&mut self) {
        self.playback = None;
        self.recorder = Some(Recorder::default());
    }

    /// Records the pose, if recording.
    pub(crate) fn record_pose(&mut self, now_s: f64, pose: Pose) {
        if let Some(recorder) = &mut self.recorder {
            recorder.record(now_s, pose);
        }
    }

    /// Ends the recording. Its path replaces the current one unless it is empty; returns true if it
    /// does.
    pub(crate) fn stop_recording(&mut self) -> bool {
        let path = self.recorder.take().and_then(Recorder::finish);
        let kept = path.is_some();
        self.path = path.or(self.path.take());
        kept
    }

    /// Starts a replay; returns false if there is no path.
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

    /// Advances the replay to `now_s`.
    pub(crate) fn step(&mut self, now_s: f64) -> Replay {
        let (Some(path), Some(playback)) = (&self.path, self.playback) else {
            return Replay::Idle;
        };
        match playback {
            Playback::InTime { started_s } => {
                let time_s = now_s - started_s;
                if time_s < path.duration_s() {
                    return Replay::LumigraphOverlay(path.pose_at(time_s));
                }
                if self.repeat && path.duration_s() > 0.0 {
                    self.playback = Some(Playback::InTime { started_s: now_s });
                    return Replay::LumigraphOverlay(path.pose_at(0.0));
                }
                self.playback = None;
                Replay::Ended(path.pose_at(path.duration_s()))
            }
            Playback::EveryPose { index } => match path.poses().get(index) {
                Some(pose) => Replay::LumigraphOverlay(pose.pose),
                None if self.repeat => {
                    self.playback = Some(Playback::EveryPose { index: 0 });
                    Replay::LumigraphOverlay(path.poses()[0].pose)
                }
                None => {
                    self.playback = None;
                    Replay::Ended(path.poses()[index - 1].pose)
                }
            },
        }
    }

    /// Advances to the next pose after the frame of pose `index` was shown, if this is the current
    /// pose ([`Self::pose_index`]).
    pub(crate) fn advance_after(&mut self, index: usize) {
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

    fn recorder(mode: ReplayMode) -> PathRecorder {
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
            Replay::LumigraphOverlay(pose) | Replay::Ended(pose) => pose.eye.x,
            Replay::Idle => f64::NAN,
        }
    }

    #[test]
    fn replay_in_time_follows_clock() {
        let mut recorder = recorder(ReplayMode::InTime);
        assert_eq!(recorder.step(5.0), Replay::Idle);
        assert!(recorder.play(10.0));
        assert_eq!(x(recorder.step(10.0)), 0.0);
        assert!((x(recorder.step(11.5)) - 1.5).abs() < 1e-9);
        recorder.advance_after(0);
        assert!((recorder.progress(11.0).unwrap() - 0.5).abs() < 1e-9);
        assert!(matches!(recorder.step(12.5), Replay::Ended(pose) if pose.eye.x == 2.0));
        assert!(!recorder.is_playing());
    }

    #[test]
    fn every_pose_waits_for_its_frame() {
        let mut recorder = recorder(ReplayMode::EveryPose);
        recorder.play(0.0);
        for (i, pose) in [0.0, 1.0, 2.0].into_iter().enumerate() {
            assert_eq!(recorder.pose_index(), Some(i));
            assert_eq!(x(recorder.step(1000.0 * pose)), pose);
            assert_eq!(
                x(recorder.step(1000.0 * pose + 1.0)),
                pose,
                "not before the frame was shown"
            );
            recorder.advance_after(i);
            recorder.advance_after(i);
        }
        assert!(matches!(recorder.step(9e9), Replay::Ended(_)));
        assert_eq!(recorder.step(9e9), Replay::Idle);
    }

    #[test]
    fn repeating_starts_again() {
        for mode in [ReplayMode::InTime, ReplayMode::EveryPose] {
            let mut recorder = PathRecorder {
                repeat: true,
                ..recorder(mode)
            };
            recorder.play(0.0);
            (0..3).for_each(|i| recorder.advance_after(i));
            assert_eq!(x(recorder.step(2.5)), 0.0);
            assert!(recorder.is_playing());
        }
    }

    #[test]
    fn an_empty_recording_keeps_the_old_path() {
        let mut recorder = recorder(ReplayMode::InTime);
        recorder.record();
        assert_eq!(recorder.recorded(), Some(0));
        assert!(!recorder.stop_recording());
        assert_eq!(recorder.path.as_ref().unwrap().poses().len(), 3);
        recorder.record();
        let pose = recorder.path.as_ref().unwrap().pose_at(1.0);
        (0..10).for_each(|i| {
            recorder.record_pose(
                f64::from(i),
                Pose {
                    eye: DVec3::X * f64::from(i),
                    ..pose
                },
            );
        });
        assert!(recorder.stop_recording());
        assert_eq!(recorder.path.as_ref().unwrap().poses().len(), 10);
        assert!(!PathRecorder::default().play(0.0), "nothing to play");
    }
}
