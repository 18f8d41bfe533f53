//! Counts of a search for depth: the reasons why nothing was found.

use std::fmt;

/// Counts of a search for depth over all views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SearchCounts {
    /// Number of perspective views.
    pub views: usize,
    /// Number of views that overlap no other view from a different position.
    pub isolated: usize,
    /// Number of pixels of the other views, at the size at which they are matched.
    pub pixels: u64,
    /// Number of these pixels whose patch has no more contrast than noise; counted only if nothing
    /// was found.
    pub textureless: u64,
    /// Number of these pixels whose patch matches one in another view.
    pub matched: u64,
    /// Number of these pixels whose depth other views confirm.
    pub confirmed: u64,
}

impl fmt::Display for SearchCounts {
    /// Writes the most probable reason with its counts, and a remedy.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let share = |count: u64| 100.0 * count as f64 / self.pixels.max(1) as f64;
        write!(f, "no depth found in {} photographs: ", self.views)?;
        if self.isolated == self.views {
            return write!(
                f,
                "none of them overlaps another from a different position; move the camera sideways between photographs, and check \
                 the cameras"
            );
        }
        let Self {
            isolated, matched, ..
        } = *self;
        write!(
            f,
            "{isolated} of them overlap no other; of the pixels of the rest, {:.1} % have no texture, {:.1} % match another photograph, \
             and none is confirmed by enough of them; ",
            share(self.textureless),
            share(matched)
        )?;
        if 2 * self.textureless > self.pixels {
            write!(
                f,
                "photograph surfaces with texture, or project a pattern on them"
            )
        } else {
            write!(
                f,
                "check the cameras, and take more photographs with smaller steps between them"
            )
        }
    }
}
