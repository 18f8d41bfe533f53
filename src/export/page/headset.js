// WebXR: both eyes of a headset, seated or about a room. Where the session begins is the centre of the headbox.
import { ofHeadset } from './camera.js';
import { clamp } from './vectors.js';

/** Half of a headbox, metres, below which the world is shown larger: a head has to fit in. */
const ROOM_M = 0.15;
/** Metres outside of the headbox over which light fades. */
const FADE_M = 0.1;

/** Offers the button if there is a headset. */
export async function offer(button) {
  const xr = navigator.xr;
  button.hidden = !(xr && (await xr.isSessionSupported('immersive-vr').catch(() => false)));
}

/** Shows a capture in a headset until the session ends. */
export async function enter(renderer, view, ended) {
  const { gl, header } = renderer;
  const session = await navigator.xr.requestSession('immersive-vr');
  await gl.makeXRCompatible();
  session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl, { antialias: false, depth: false }) });
  const space = await session.requestReferenceSpace('local');
  const metres = Math.min(header.halfSize / ROOM_M, 1);
  const turn = Math.atan2(view.forward[0], -view.forward[2]);
  const onFrame = (_, frame) => {
    session.requestAnimationFrame(onFrame);
    const pose = frame.getViewerPose(space);
    if (!pose) return;
    const layer = session.renderState.baseLayer;
    for (const eye of pose.views) {
      const { x, y, width, height } = layer.getViewport(eye);
      const matrix = turnedPose(eye.transform.matrix, turn);
      const wanted = [12, 13, 14].map((i) => matrix[i] * metres);
      const inside = wanted.map((c) => clamp(c, -header.halfSize, header.halfSize));
      const outside = Math.hypot(...wanted.map((c, i) => c - inside[i]));
      const camera = ofHeadset(inside, matrix, eye.projectionMatrix, [width, height]);
      renderer.draw(camera, layer.framebuffer, [x, y], 1 - 0.8 * clamp(outside / FADE_M, 0, 1));
    }
    document.body.dataset.headsetEyes = pose.views.length;
  };
  session.addEventListener('end', ended);
  session.requestAnimationFrame(onFrame);
  return session;
}

/** A pose, column by column, turned to the right about Y. */
function turnedPose(matrix, angle) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  const result = Array.from(matrix);
  for (let i = 0; i < 16; i += 4) {
    [result[i], result[i + 2]] = [matrix[i] * cos - matrix[i + 2] * sin, matrix[i] * sin + matrix[i + 2] * cos];
  }
  return result;
}
