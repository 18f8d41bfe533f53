//! Metadata of spherical MP4 films: Google's *Spherical Video V2* (boxes `st3d` and `sv3d` in the
//! video's sample entry), from which players learn the projection and which half each eye sees.
//! ffmpeg converts these to WebM's elements.

use super::stereo::View;
use std::io;

/// Spherical projection of a film.
struct Spherical {
    /// `stereo_mode` of `st3d`: 0 one eye, 1 the left one above, 2 the left one on the left.
    stereo: u8,
    /// Share of the equirectangular projection that is missing on the left and on the right, of
    /// 2^32.
    beside: u32,
}

impl Spherical {
    fn of(view: View) -> Option<Self> {
        match view {
            View::Panorama => Some(Self {
                stereo: 0,
                beside: 0,
            }),
            View::StereoPanorama(_) => Some(Self {
                stereo: 1,
                beside: 0,
            }),
            View::HalfSpheres(_) => Some(Self {
                stereo: 2,
                beside: 1 << 30,
            }),
            View::Frame | View::SideBySide(_) => None,
        }
    }

    fn boxes(&self) -> Vec<u8> {
        let words = |words: &[u32]| {
            words
                .iter()
                .flat_map(|word| word.to_be_bytes())
                .collect::<Vec<u8>>()
        };
        // Version and flags first, then heading, pitch and roll; and what is missing above, below,
        // left and right.
        let (prhd, equi) = (
            boxed(b"prhd", &words(&[0; 4])),
            boxed(b"equi", &words(&[0, 0, 0, self.beside, self.beside])),
        );
        let svhd = boxed(b"svhd", &[&[0; 4], b"headbox\0".as_slice()].concat());
        let proj = boxed(b"proj", &[prhd, equi].concat());
        let st3d = boxed(b"st3d", &[0, 0, 0, 0, self.stereo]);
        [st3d, boxed(b"sv3d", &[svhd, proj].concat())].concat()
    }
}

fn boxed(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    [
        (content.len() as u32 + 8).to_be_bytes().as_slice(),
        name,
        content,
    ]
    .concat()
}

/// Boxes on the way to the video's sample entry, of H.264 or VP9, and bytes of each before its
/// first child.
const WAY: [(&[&[u8; 4]], usize); 7] = [
    (&[b"moov"], 8),
    (&[b"trak"], 8),
    (&[b"mdia"], 8),
    (&[b"minf"], 8),
    (&[b"stbl"], 8),
    (&[b"stsd"], 16),
    (&[b"avc1", b"vp09"], 86),
];

/// Returns true if a view has metadata.
pub(super) fn is_told(view: View) -> bool {
    Spherical::of(view).is_some()
}

/// An MP4 file with one video track that says what a view surrounds the eye with; of other views as
/// it is.
///
/// # Errors
/// If it is no such file.
pub(super) fn tagged(mut film: Vec<u8>, view: View) -> io::Result<Vec<u8>> {
    let Some(spherical) = Spherical::of(view) else {
        return Ok(film);
    };
    let wrong =
        || io::Error::other("the film that ffmpeg made has no video track where one is expected");
    let more = spherical.boxes();
    let mut within = 0..film.len();
    let mut way = Vec::new();
    for (names, head) in WAY {
        let found = find(&film, within, names).ok_or_else(wrong)?;
        way.push(found.start);
        within = found.start + head..found.end;
    }
    let (moov, table, end) = (way[0], way[4], within.end);
    shift_chunks(&mut film, table, moov, more.len() as u32).ok_or_else(wrong)?;
    for start in way {
        let size = word(&film, start).ok_or_else(wrong)? + more.len() as u32;
        film[start..start + 4].copy_from_slice(&size.to_be_bytes());
    }
    film.splice(end..end, more);
    Ok(film)
}

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
        // A size of 0 or 1 (to the end, 64 bits) is that of media alone, which comes last.
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

/// Moves the places of chunks of media that lie behind the box that grows; `table`: where `stbl`
/// begins.
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
            let stsd = boxed(
                b"stsd",
                &[vec![0, 0, 0, 0, 0, 0, 0, 1], boxed(codec, &[7; 90])].concat(),
            );
            let stco = boxed(
                b"stco",
                &[[0, 0, 0, 0], [0, 0, 0, 1], place.to_be_bytes()].concat(),
            );
            let nested = [b"stbl", b"minf", b"mdia", b"trak", b"moov"];
            let moov = nested
                .iter()
                .fold([stsd, stco].concat(), |content, name| boxed(name, &content));
            [boxed(b"ftyp", b"isom"), moov, boxed(b"mdat", b"MEDIA")].concat()
        };
        let place = file(0).len() as u32 - 5;
        file(place)
    }

    #[test]
    fn panorama_metadata_keeps_media_offsets() {
        for (view, stereo, beside, codec) in [
            (View::Panorama, 0, 0, b"avc1"),
            (View::StereoPanorama(0.06), 1, 0, b"vp09"),
            (View::HalfSpheres(0.06), 2, 1 << 30, b"avc1"),
        ] {
            let plain = film(codec);
            assert_eq!(tagged(plain.clone(), View::Frame).unwrap(), plain);
            let tagged = tagged(plain, view).unwrap();
            let mut within = 0..tagged.len();
            for (names, head) in WAY {
                let found = find(&tagged, within, names).unwrap();
                within = found.start + head..found.end;
            }
            // Children of the sample entry: what it had, which is no box here, and ours.
            let ours = within.end - Spherical::of(view).unwrap().boxes().len()..within.end;
            let st3d = find(&tagged, ours.clone(), &[b"st3d"]).unwrap();
            let sv3d = find(&tagged, ours, &[b"sv3d"]).unwrap();
            let proj = find(&tagged, sv3d.start + 8..sv3d.end, &[b"proj"]).unwrap();
            let equi = find(&tagged, proj.start + 8..proj.end, &[b"equi"]).unwrap();
            assert_eq!(
                (tagged[st3d.start + 12], word(&tagged, equi.end - 4)),
                (stereo, Some(beside))
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
        for film in [Vec::new(), vec![0; 40], short] {
            assert!(
                tagged(film, View::Panorama)
                    .unwrap_err()
                    .to_string()
                    .contains("no video track")
            );
        }
    }
}
