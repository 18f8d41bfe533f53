// Pictures that travel as PNG files.

const AS_IT_IS = { premultiplyAlpha: 'none', colorSpaceConversion: 'none' };

/** The picture of a file, its colours as they are, no wider or higher than `most`. */
export async function pictureOf(bytes, most) {
  const picture = await createImageBitmap(new Blob([bytes], { type: 'image/png' }), AS_IT_IS);
  const share = most / Math.max(picture.width, picture.height);
  if (share >= 1) return picture;
  const [resizeWidth, resizeHeight] = [picture.width, picture.height].map((side) => Math.max(Math.floor(side * share), 1));
  return createImageBitmap(picture, { ...AS_IT_IS, resizeWidth, resizeHeight, resizeQuality: 'high' });
}
