//! Texture atlas: packs many small images into few large pages.

/// Size of a page, pixels: supported by every engine and phone.
pub(crate) const PAGE_PX: usize = 4096;

/// Image to be placed in the atlas.
pub(crate) struct AtlasPicture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// sRGB, straight alpha; rows from the top.
    pub(crate) texels: Vec<[u8; 4]>,
}

/// Position of an image in the atlas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct AtlasPlace {
    pub(crate) page: usize,
    pub(crate) x: usize,
    pub(crate) y: usize,
}

/// Page, as high as the images on it.
pub(crate) struct AtlasPage {
    pub(crate) height: usize,
    /// Texels, [`PAGE_PX`] per row.
    pub(crate) texels: Vec<[u8; 4]>,
}

/// Packs images in rows ("shelves"), the tallest first. Images are at most [`PAGE_PX`] wide and
/// high.
pub(crate) fn pack(pictures: &[&AtlasPicture]) -> (Vec<AtlasPlace>, Vec<AtlasPage>) {
    let mut order: Vec<usize> = (0..pictures.len()).collect();
    order.sort_by_key(|i| (std::cmp::Reverse(pictures[*i].height), *i));
    let mut places = vec![AtlasPlace::default(); pictures.len()];
    let (mut at, mut shelf) = (AtlasPlace::default(), 0);
    let mut heights = Vec::new();
    for i in order {
        let AtlasPicture { width, height, .. } = pictures[i];
        if at.x + width > PAGE_PX {
            (at.x, at.y, shelf) = (0, at.y + shelf, 0);
        }
        if at.y + height > PAGE_PX {
            at = AtlasPlace {
                page: at.page + 1,
                x: 0,
                y: 0,
            };
            shelf = 0;
        }
        places[i] = at;
        at.x += width;
        shelf = shelf.max(*height);
        heights.resize(heights.len().max(at.page + 1), 0);
        heights[at.page] = heights[at.page].max(at.y + height);
    }
    let mut pages: Vec<AtlasPage> = heights
        .into_iter()
        .map(|height| AtlasPage {
            height,
            texels: vec![[0; 4]; height * PAGE_PX],
        })
        .collect();
    for (picture, place) in pictures.iter().zip(&places) {
        for (row, texels) in picture.texels.chunks_exact(picture.width).enumerate() {
            let start = (place.y + row) * PAGE_PX + place.x;
            pages[place.page].texels[start..start + picture.width].copy_from_slice(texels);
        }
    }
    (places, pages)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_images_do_not_overlap() {
        let sizes = [
            (4096, 3000),
            (2000, 1500),
            (2096, 900),
            (7, 1),
            (1, 7),
            (4096, 1),
        ];
        let picture = |(i, (width, height)): (usize, &(usize, usize))| AtlasPicture {
            width: *width,
            height: *height,
            texels: vec![[i as u8 + 1; 4]; width * height],
        };
        let pictures: Vec<AtlasPicture> = sizes.iter().enumerate().map(picture).collect();
        let (places, pages) = pack(&pictures.iter().collect::<Vec<_>>());
        assert!(pages.len() == 2 && pages.iter().all(|page| page.height <= PAGE_PX));
        for (i, (place, (width, height))) in places.iter().zip(sizes).enumerate() {
            for (x, y) in [
                (0, 0),
                (width - 1, 0),
                (0, height - 1),
                (width - 1, height - 1),
            ] {
                let texel = pages[place.page].texels[(place.y + y) * PAGE_PX + place.x + x];
                assert_eq!(texel[0], i as u8 + 1);
            }
        }
    }
}
