// Pictures that travel as PNG files.

/** The picture of a file, its colours as they are. */
export const pictureOf = (bytes) =>
  createImageBitmap(new Blob([bytes], { type: 'image/png' }), { premultiplyAlpha: 'none', colorSpaceConversion: 'none' });
