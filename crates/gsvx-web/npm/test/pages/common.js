// What the pages of the adapters' tests share: the camera, and what the test asks for.
export const query = Object.fromEntries(new URLSearchParams(location.search));
export const camera = JSON.parse(query.camera);

/** The columns of the camera's matrix: x to the right, y up, z towards the viewer. */
export function columns() {
  const r = camera.rotation;
  const column = (k, sign) => [0, 1, 2].map((i) => sign * r[i][k]);
  return [column(0, 1), column(1, -1), column(2, -1), camera.position];
}

export const fov = (2 * Math.atan(camera.height / 2 / camera.fy) * 180) / Math.PI;
export const aspect = camera.width / camera.height;

/** A three.js camera at the place of the test's. */
export function threeCamera({ PerspectiveCamera, Matrix4, Vector3 }) {
  const made = new PerspectiveCamera(fov, aspect, 0.01, 100);
  const [x, y, z, place] = columns().map((v) => new Vector3(...v));
  made.matrixAutoUpdate = false;
  made.matrix.copy(new Matrix4().makeBasis(x, y, z).setPosition(place));
  made.matrixWorldNeedsUpdate = true;
  made.updateMatrixWorld(true);
  return made;
}

window.state = { pictures: 0, log: [] };
window.addEventListener('error', (e) => { window.state.error = String(e.message); });
window.addEventListener('unhandledrejection', (e) => { window.state.error ??= String(e.reason?.message ?? e.reason); });

/** Tells the test how a loading ended; `more` gets what it gave. */
export const settle = (loading, more = () => {}) => loading.then(more, (error) => {
  state.failed = { message: error.message ?? error, code: error.code, chunk: error.chunk };
}).then(() => { state.done = true; });

/** Draws a scene in every frame with a renderer of three.js. */
export function animate(renderer, scene, three) {
  const view = threeCamera(three);
  renderer.setSize(camera.width, camera.height);
  document.body.append(renderer.domElement);
  renderer.setAnimationLoop(() => renderer.render(scene, view));
}
