// WebXR: both eyes of a headset, seated or about a room. Where the session begins is where the eye was.
import { ofHeadset } from './camera.js';
import { alongAxes, clamp, fromAxes } from './vectors.js';

/** Metres outside of where the eye may be over which light fades. */
const FADE_M = 0.1;
/** What a stick must be off its middle to count. */
const STICK = 0.2;

/** Offers the button if there is a headset. */
export async function offer(button) {
  const xr = navigator.xr;
  button.hidden = !(xr && (await xr.isSessionSupported('immersive-vr').catch(() => false)));
}

/** Shows what a page holds in a headset until the session ends. */
export async function enter(renderer, view, ended) {
  const { gl } = renderer;
  const session = await navigator.xr.requestSession('immersive-vr');
  await gl.makeXRCompatible();
  session.updateRenderState({ baseLayer: new XRWebGLLayer(session, gl, renderer.buffers) });
  const space = await session.requestReferenceSpace('local');
  const [x, , z] = alongAxes(view.axes, view.forward);
  const turn = Math.atan2(x, -z);
  let from = view.eye;
  let before = null;
  const onFrame = (time, frame) => {
    session.requestAnimationFrame(onFrame);
    const pose = frame.getViewerPose(space);
    if (!pose) return;
    if (view.place.walks && before !== null) from = walked(from, session, turnedPose(pose.transform.matrix, turn, view.axes), view, (time - before) / 1000);
    before = time;
    const layer = session.renderState.baseLayer;
    for (const eye of pose.views) {
      const { x, y, width, height } = layer.getViewport(eye);
      const matrix = turnedPose(eye.transform.matrix, turn, view.axes);
      const head = view.place.ofHead(from, [12, 13, 14].map((i) => matrix[i]));
      const camera = ofHeadset(head.eye, matrix, eye.projectionMatrix, [width, height]);
      renderer.draw(camera, layer.framebuffer, [x, y], 1 - 0.8 * clamp(head.outside / FADE_M, 0, 1));
    }
    document.body.dataset.headsetEyes = pose.views.length;
  };
  session.addEventListener('end', ended);
  session.requestAnimationFrame(onFrame);
  return session;
}

/** Where the sticks of the controllers take somebody who looks along the -Z of a pose. */
function walked(from, session, pose, view, seconds) {
  const [across, back] = [...session.inputSources].reduce(
    ([x, y], { gamepad }) => [x + (gamepad?.axes[2] ?? 0), y + (gamepad?.axes[3] ?? 0)],
    [0, 0],
  );
  const length = Math.hypot(pose[8], pose[10]);
  if (Math.hypot(across, back) < STICK || length < 1e-3) return from;
  // Level, whatever the head's tilt.
  const [x, z] = [pose[8] / length, pose[10] / length];
  const metres = view.place.speed * Math.min(seconds, 0.1);
  return view.place.step(from, [(across * z + back * x) * metres, 0, (back * z - across * x) * metres]);
}

/** A pose, column by column, turned to the right about Y, its vectors along `axes`. */
function turnedPose(matrix, angle, axes) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  const result = Array.from(matrix);
  for (let i = 0; i < 16; i += 4) {
    const level = [matrix[i] * cos - matrix[i + 2] * sin, matrix[i + 1], matrix[i] * sin + matrix[i + 2] * cos];
    result.splice(i, 3, ...fromAxes(axes, level));
  }
  return result;
}
