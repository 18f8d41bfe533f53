//! Temporary folder of scene files.

use headbox_model::load::load_scene as load;
use headbox_scene::load::LoadOptions;
use headbox_scene::scene::Scene;

/// One clean triangle, four lines.
pub(crate) const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().expect("inside the folder")).expect("a folder");
        std::fs::write(path, content).expect("written");
    }

    /// Path of a file in the folder.
    pub(crate) fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.0.path().join(name)).expect("there")
    }

    /// Writes an image one texel high, in the format of its extension.
    pub(crate) fn write_image(&self, name: &str, texels: &[[u8; 4]]) {
        let rgba =
            image::RgbaImage::from_raw(texels.len() as u32, 1, texels.concat()).expect("one row");
        let image = image::DynamicImage::from(rgba);
        let path = self.0.path().join(name);
        let image = match path.extension().and_then(|e| e.to_str()) {
            Some("jpg") => image.to_rgb8().into(),
            Some("hdr") => image.to_rgb32f().into(),
            _ => image,
        };
        image.save(path).expect("an image");
    }

    pub(crate) fn load(&self, name: &str) -> Result<Scene, String> {
        self.load_with(name, &LoadOptions::default())
    }

    /// Loads a file; a scene that loads is valid.
    pub(crate) fn load_with(&self, name: &str, options: &LoadOptions) -> Result<Scene, String> {
        let scene = load(&self.0.path().join(name), options).map_err(|e| e.to_string())?;
        assert_eq!(scene.validate(), Ok(()));
        Ok(scene)
    }
}

/// Returns the beginning of a PNG file with this size in its header.
pub(crate) fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut chunk = b"IHDR".to_vec();
    chunk.extend(width.to_be_bytes());
    chunk.extend(height.to_be_bytes());
    chunk.extend([8, 6, 0, 0, 0]);
    let crc = chunk.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            if crc & 1 == 1 {
                crc >> 1 ^ 0xedb8_8320
            } else {
                crc >> 1
            }
        })
    });
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    png.extend(chunk);
    png.extend((!crc).to_be_bytes());
    png.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    png
}
