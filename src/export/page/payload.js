// The data in the page: parts, each in a script element of its own, as text of seven bits a character (text.rs), deflated.

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  for (let bit = 0; bit < 8; bit++) byte = byte & 1 ? (byte >>> 1) ^ 0xedb88320 : byte >>> 1;
  return byte;
});

/** The CRC-32 of bytes, as in zlib. */
function crc32(bytes) {
  let sum = ~0;
  for (let i = 0; i < bytes.length; i++) sum = CRC_TABLE[(sum ^ bytes[i]) & 255] ^ (sum >>> 8);
  return ~sum >>> 0;
}

const damaged = (what) => new Error(`This page is damaged: ${what}. Export or download it again.`);

/** The header in an element, verified. */
export function readHeader(holder) {
  const text = holder.textContent;
  if (crc32(new TextEncoder().encode(text)) !== Number(holder.dataset.crc32)) throw damaged('its header does not match its checksum');
  return JSON.parse(text);
}

const KEPT_OUT = [0, 13, 60];

/** The bytes behind the text of a part. */
export function bytesOf(text, count) {
  const bytes = new Uint8Array(count);
  let [bits, held, at] = [0, 0, 0];
  for (let i = 0; i < text.length; i++) {
    const c = text.charCodeAt(i);
    bits |= (c < 128 ? c : KEPT_OUT[c - 128]) << held;
    held += 7;
    if (held >= 8) {
      bytes[at++] = bits;
      bits >>= 8;
      held -= 8;
    }
  }
  if (at < count) throw new Error(`a part of ${count} bytes has only ${at}`);
  return bytes;
}

/** Inflates a part. */
async function inflate(bytes, count) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  const whole = new Uint8Array(await new Response(stream).arrayBuffer());
  if (whole.length !== count) throw new Error(`${count} bytes are expected, there are ${whole.length}`);
  return whole;
}

const pause = () => new Promise((resolve) => setTimeout(resolve, 5));

/** The element of a part, once the parser has come to its end. */
async function element(number) {
  for (;;) {
    const found = document.getElementById(`part-${number}`);
    const complete = found && (document.getElementById(`part-${number + 1}`) || document.readyState !== 'loading');
    if (complete) return found;
    if (document.readyState !== 'loading') throw damaged(`part ${number + 1} is missing`);
    await pause();
  }
}

/** Yields the parts in their order: what the header says of each, and its bytes. Frees each text. */
export async function* parts(header) {
  for (let number = 0; number < header.parts.length; number++) {
    const part = header.parts[number];
    const holder = await element(number);
    let bytes;
    try {
      const packed = bytesOf(holder.textContent, part.packed);
      if (crc32(packed) !== part.crc32) throw new Error('it does not match its checksum');
      bytes = await inflate(packed, part.bytes);
    } catch (error) {
      throw damaged(`part ${number + 1} of ${header.parts.length}: ${error.message}`);
    }
    holder.dataset.bytes = part.text;
    holder.textContent = '';
    yield [part, bytes];
  }
}
