// The data in the page: parts, each in a script element of its own, as text of seven bits a character (text.rs), deflated.

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

/** What deflate made of a part; its checksum is verified on the way. */
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
    if (document.readyState !== 'loading') throw new Error('it is cut off');
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
      bytes = await inflate(bytesOf(holder.textContent, part.packed), part.bytes);
    } catch (error) {
      throw new Error(`part ${number + 1} of ${header.parts.length} of this page is damaged (${error.message})`);
    }
    holder.textContent = '';
    yield [part, bytes];
  }
}
