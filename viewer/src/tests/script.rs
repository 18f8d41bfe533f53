use super::*;
use crate::Exit;
use egui::ViewportCommand;

fn is_closing(window: &Window) -> bool {
    window
        .output()
        .viewport_output
        .values()
        .any(|v| v.commands.contains(&ViewportCommand::Close))
}

#[test]
fn window_closes_after_requested_frames() {
    let mut window = room_with(
        Kind::Headbox,
        ViewerOptions {
            exit: Exit::AfterFrames(5),
            ..ViewerOptions::default()
        },
    );
    step_until(&mut window, "the end", |window| {
        is_closing(window) || window.state().automation.is_closing()
    });
    let outcome = window.state().outcome.lock().unwrap().clone();
    assert!(outcome.error.is_none());
    assert!(
        outcome.summary.frames_shown >= 5 && outcome.summary.first_image_s.is_some(),
        "{:?}",
        outcome.summary
    );
}

#[test]
fn the_window_closes_after_the_thumbnails() {
    let options = ViewerOptions {
        exit: Exit::AfterThumbnails,
        library: Some(Box::new(Rooms)),
        ..Default::default()
    };
    let mut window = open(None, options);
    // Building a window already runs passes, in which it may have requested to close.
    wait(&mut window, "the end", |viewer| {
        viewer.automation.is_closing()
    });
    assert!(window.state().start_page.has_all_thumbnails());
}

#[test]
fn window_closes_when_refined() {
    let settings = vec![("refine".into(), "on".into())];
    let options = ViewerOptions {
        exit: Exit::WhenRefined,
        settings,
        ..ViewerOptions::default()
    };
    let mut window = room_with(Kind::Headbox, options);
    wait(&mut window, "the end", |viewer| {
        viewer.automation.is_closing()
    });
    let shown = window.state().shown.as_ref().unwrap();
    assert!(shown.job.round > 0 && shown.pictures[0].report.refinement == crate::Refinement::Done);
}

#[test]
fn any_error_ends_a_scripted_run() {
    let settings = vec![("fail".into(), "on".into())];
    let options = ViewerOptions {
        exit: Exit::AfterFrames(5),
        settings,
        ..ViewerOptions::default()
    };
    let mut window = open(Some(Box::new(CheckerRoom::new(Kind::Headbox))), options);
    wait(&mut window, "the end", |viewer| {
        viewer.automation.is_closing()
    });
    assert_eq!(
        window.state().outcome.lock().unwrap().error.as_deref(),
        Some("The room was asked to fail.")
    );
}

#[test]
fn unknown_settings_are_reported() {
    let settings = vec![("lmap".into(), "on".into()), ("lamp".into(), "off".into())];
    let window = room_with(
        Kind::Headbox,
        ViewerOptions {
            settings,
            ..ViewerOptions::default()
        },
    );
    assert!(
        texts(&window)[0].contains("\"lmap\""),
        "{:?}",
        texts(&window)
    );
    assert_eq!(
        window.state().sets.a.toggle("lamp"),
        Ok(false),
        "the others hold"
    );
}

#[test]
fn window_without_source_or_path_is_refused() {
    assert!(matches!(
        crate::run(None, ViewerOptions::default()),
        Err(crate::ViewerError::NothingToShow)
    ));
    let options = ViewerOptions {
        exit: Exit::AfterPath,
        ..ViewerOptions::default()
    };
    let source: Box<dyn FrameSource> = Box::new(CheckerRoom::new(Kind::Headbox));
    assert!(matches!(
        crate::run(Some(source), options),
        Err(crate::ViewerError::NoPath)
    ));
}
