//! The window of headbox: shows anything that turns a camera into a frame.
