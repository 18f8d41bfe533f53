//! Errors of reading image sets.

use headbox_core::image::codec::PictureError;
use headbox_core::memory::OverBudget;
use std::path::{Path, PathBuf};

/// Error of reading an image set. Each message is one sentence that names the file and, if there is
/// one, the field.
#[derive(Debug, thiserror::Error)]
pub enum ImagesError {
    /// A file or folder cannot be opened or read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        cause: std::io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        cause: std::io::Error,
    },
    /// The folder holds none of the supported formats.
    #[error(
        "{folder}: not an image set; expected manifest.json (Seurat), transforms.json (nerfstudio), cameras.bin or cameras.txt \
                 (COLMAP), frame-*.pose.txt (RGB-D frames), \
                 pose and color (ScanNet), groundtruth.txt (TUM), traj.txt (Replica), keyframes (Polycam), metadata.json (Record3D), cameras.json (3D Gaussian Splatting), \
                 *.xml (Metashape), *_par.txt (Middlebury), *.P or *.mat (projection matrices), or panoramas with depth next to them \
                 (NAME.png and NAME_depth.exr); to read a deep EXR, name the file itself; for photographs without known cameras, \
                 headbox images {folder} --align finds them with COLMAP",
        folder = path.display()
    )]
    NoImageSet {
        /// The folder.
        path: PathBuf,
    },
    /// A field of a file is missing or invalid.
    #[error("{}: {field}: {cause}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Path of the field in the file.
        field: String,
        /// Problem, as the rest of a sentence about the field.
        cause: String,
    },
    /// An image cannot be decoded or does not fit the set.
    #[error("{}: {cause}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Problem, as the rest of a sentence about the file.
        cause: String,
    },
    /// The samples of the images are too many for the memory that is left.
    #[error("merging the images {0}")]
    Memory(OverBudget),
    /// A path leads out of the set's folder.
    #[error("{}: {field}: \"{leads_to}\" leads out of the folder; pass --allow-outside if you trust the file", path.display())]
    Outside {
        /// The file that contains the path.
        path: PathBuf,
        /// Path of the field in the file.
        field: String,
        /// The offending path.
        leads_to: String,
    },
}

impl ImagesError {
    pub(crate) fn field(path: &Path, field: impl Into<String>, cause: impl Into<String>) -> Self {
        Self::Field {
            path: path.into(),
            field: field.into(),
            cause: cause.into(),
        }
    }

    pub(crate) fn io(path: &Path, cause: std::io::Error) -> Self {
        Self::Io {
            path: path.into(),
            cause,
        }
    }

    pub(crate) fn write(path: &Path, cause: std::io::Error) -> Self {
        Self::Write {
            path: path.into(),
            cause,
        }
    }

    pub(crate) fn picture(path: &Path, error: PictureError) -> Self {
        match error {
            PictureError::Io(cause) => Self::io(path, cause),
            error => Self::invalid_picture(path, error.to_string()),
        }
    }

    pub(crate) fn invalid_picture(path: &Path, cause: impl Into<String>) -> Self {
        Self::Picture {
            path: path.into(),
            cause: cause.into(),
        }
    }
}
