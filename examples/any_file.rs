//! Opens a file of any representation through the `View` trait, lists its settings, and draws it
//! with each of its variants.
//!
//! ```text
//! cargo run --release --example any_file -- FILE [FOLDER]
//! ```

use headbox_core::view::{Control, FrameRequest, SettingValues};
use std::path::PathBuf;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = PathBuf::from(arguments.next().ok_or("give a file")?);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| ".".into()));
    std::fs::create_dir_all(&folder)?;

    let representation = headbox_views::find(&file).ok_or("not a file of headbox")?;
    let mut view = (representation.open)(&file)?;
    let (count, primitives) = view.primitives();
    println!("{}: {count} {primitives}", view.kind());

    let settings = view.settings();
    for setting in &settings {
        println!("  {}: {}", setting.id, setting.tooltip);
    }
    let camera = view.start([320, 240]).camera([320, 240])?;
    let mut values = SettingValues::initial(&settings);
    let variant = settings
        .iter()
        .find(|setting| setting.flag == Some("variant"));
    let variants = match variant.map(|setting| &setting.control) {
        Some(Control::Choice { options, .. }) => options.clone(),
        _ => vec!["default".into()],
    };
    for name in &variants {
        if let Some(variant) = variant {
            values.set_text(&settings, variant.id, name)?;
        }
        let request = FrameRequest::complete(camera, Arc::new(values.clone()));
        let rendered = view.render(&request)?;
        let file = folder.join(format!("{}_{name}.png", representation.extension));
        rendered.frame.save(&file)?;
        println!("{}: {:.2} ms", file.display(), rendered.report.ms);
    }
    Ok(())
}
