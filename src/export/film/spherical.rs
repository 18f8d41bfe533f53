//! Metadata of spherical MP4 films: Google's *Spherical Video V2* (boxes `st3d` and `sv3d` in the
//! video's sample entry), which give players the projection and each eye's half. ffmpeg converts
//! them to WebM's elements.

use crate::film::stereo::View;
use std::io;

/// Spherical projection of a film.
pub(crate) struct Spherical {
    /// `stereo_mode` of `st3d`: 0 for one eye, 1 with the left eye above, 2 with the left eye on
    /// the left.
    stereo: u8,
    /// Share of the equirectangular projection that is cropped on the left and on the right, in
    /// units of 2^-32.
    cropped: u32,
}

impl Spherical {
    /// Returns the projection of a view; `None` for perspective views.
    pub(crate) fn for_view(view: View) -> Option<Self> {
        let (stereo, cropped) = match view {
            View::Panorama => (0, 0),
            View::StereoPanorama(_) => (1, 0),
            View::HalfSpheres(_) => (2, 1 << 30),
            View::Frame | View::SideBySide(_) => return None,
        };
        Some(Self { stereo, cropped })
    }

    /// Adds the metadata to an MP4 file with one video track.
    ///
    /// # Errors
    /// If it is not such a file.
    pub(crate) fn add_metadata(&self, mut film: Vec<u8>) -> io::Result<Vec<u8>> {
        let wrong = || {
            io::Error::other("the film that ffmpeg made has no video track where one is expected")
        };
        let metadata = self.boxes();
        let mut within = 0..film.len();
        let mut path = Vec::new();
        for (names, head) in PATH {
            let found = find(&film, within, names).ok_or_else(wrong)?;
            path.push(found.start);
            within = found.start + head..found.end;
        }
        let (moov, table, end) = (path[0], path[4], within.end);
        shift_chunks(&mut film, table, moov, metadata.len() as u32).ok_or_else(wrong)?;
        for start in path {
            let size = word(&film, start).ok_or_else(wrong)? + metadata.len() as u32;
            film[start..start + 4].copy_from_slice(&size.to_be_bytes());
        }
        film.splice(end..end, metadata);
        Ok(film)
    }

    fn boxes(&self) -> Vec<u8> {
        let words = |words: &[u32]| {
            words
                .iter()
                .flat_map(|word| word.to_be_bytes())
                .collect::<Vec<u8>>()
        };
        // Version and flags, then heading, pitch and roll; in `equi` the crop at the top, bottom,
        // left and right.
        let prhd = mp4_box(b"prhd", &words(&[0; 4]));
        let equi = mp4_box(b"equi", &words(&[0, 0, 0, self.cropped, self.cropped]));
        let svhd = mp4_box(b"svhd", &[&[0; 4], b"headbox\0".as_slice()].concat());
        let proj = mp4_box(b"proj", &[prhd, equi].concat());
        let st3d = mp4_box(b"st3d", &[0, 0, 0, 0, self.stereo]);
        [st3d, mp4_box(b"sv3d", &[svhd, proj].concat())].concat()
    }
}

fn mp4_box(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    [
        (content.len() as u32 + 8).to_be_bytes().as_slice(),
        name,
        content,
    ]
    .concat()
}

/// Path of boxes to the video's sample entry, of H.264 or VP9, with the bytes of each before its
/// first child.
const PATH: [(&[&[u8; 4]], usize); 7] = [
    (&[b"moov"], 8),
    (&[b"trak"], 8),
    (&[b"mdia"], 8),
    (&[b"minf"], 8),
    (&[b"stbl"], 8),
    (&[b"stsd"], 16),
    (&[b"avc1", b"vp09"], 86),
];

fn word(film: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(film.get(at..at + 4)?.try_into().ok()?))
}

/// Finds the first box with one of the names among consecutive boxes.
fn find(
    film: &[u8],
    within: std::ops::Range<usize>,
    names: &[&[u8; 4]],
) -> Option<std::ops::Range<usize>> {
    let mut at = within.start;
    while at + 8 <= within.end {
        // Only media boxes, which come last, have a size of 0 (to the end) or 1 (64 bits).
        let end = at + word(film, at)? as usize;
        if end < at + 8 || end > within.end {
            return None;
        }
        if names.contains(&film.get(at + 4..at + 8)?.as_array()?) {
            return Some(at..end);
        }
        at = end;
    }
    None
}

/// Adjusts the offsets of media chunks behind the box that grows; `table` is the start of `stbl`.
fn shift_chunks(film: &mut [u8], table: usize, moov: usize, by: u32) -> Option<()> {
    let end = table + word(film, table)? as usize;
    let chunks = find(film, table + 8..end, &[b"stco"])?;
    let count = word(film, chunks.start + 12)? as usize;
    for at in (0..count).map(|i| chunks.start + 16 + 4 * i) {
        let place = word(film, at)?;
        if place as usize > moov {
            film[at..at + 4].copy_from_slice(&(place + by).to_be_bytes());
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file as ffmpeg writes it with its index first: one chunk of media, `MEDIA`, and where it
    /// says that it is.
    fn film(codec: &[u8; 4]) -> Vec<u8> {
        let file = |place: u32| {
            let stsd = mp4_box(
                b"stsd",
                &[vec![0, 0, 0, 0, 0, 0, 0, 1], mp4_box(codec, &[7; 90])].concat(),
            );
            let stco = mp4_box(
                b"stco",
                &[[0, 0, 0, 0], [0, 0, 0, 1], place.to_be_bytes()].concat(),
            );
            let nested = [b"stbl", b"minf", b"mdia", b"trak", b"moov"];
            let moov = nested.iter().fold([stsd, stco].concat(), |content, name| {
                mp4_box(name, &content)
            });
            [mp4_box(b"ftyp", b"isom"), moov, mp4_box(b"mdat", b"MEDIA")].concat()
        };
        let place = file(0).len() as u32 - 5;
        file(place)
    }

    #[test]
    fn panorama_metadata_keeps_media_offsets() {
        for (view, stereo, cropped, codec) in [
            (View::Panorama, 0, 0, b"avc1"),
            (View::StereoPanorama(0.06), 1, 0, b"vp09"),
            (View::HalfSpheres(0.06), 2, 1 << 30, b"avc1"),
        ] {
            let plain = film(codec);
            let spherical = Spherical::for_view(view).unwrap();
            let tagged = spherical.add_metadata(plain).unwrap();
            let mut within = 0..tagged.len();
            for (names, head) in PATH {
                let found = find(&tagged, within, names).unwrap();
                within = found.start + head..found.end;
            }
            // Children of the sample entry: what it had, which is no box here, and ours.
            let ours = within.end - spherical.boxes().len()..within.end;
            let st3d = find(&tagged, ours.clone(), &[b"st3d"]).unwrap();
            let sv3d = find(&tagged, ours, &[b"sv3d"]).unwrap();
            let proj = find(&tagged, sv3d.start + 8..sv3d.end, &[b"proj"]).unwrap();
            let equi = find(&tagged, proj.start + 8..proj.end, &[b"equi"]).unwrap();
            assert_eq!(
                (tagged[st3d.start + 12], word(&tagged, equi.end - 4)),
                (stereo, Some(cropped))
            );
            let stco = tagged.windows(4).position(|name| name == b"stco").unwrap();
            let place = word(&tagged, stco + 12).unwrap() as usize;
            assert_eq!(&tagged[place..], b"MEDIA");
        }
    }

    #[test]
    fn damaged_film_is_refused() {
        let mut short = film(b"avc1");
        short.truncate(60);
        let spherical = Spherical::for_view(View::Panorama).unwrap();
        for film in [Vec::new(), vec![0; 40], short] {
            let error = spherical.add_metadata(film).unwrap_err().to_string();
            assert!(error.contains("no video track"));
        }
    }
}
