// Shows the frames that the page holds. All there is to know is in two elements of it: `description`, JSON, and `data`,
// base64 of zlib of numbers; html_page.py says which.
import * as THREE from "three";
import { OrbitControls } from "orbit-controls";

const element = (id) => document.getElementById(id);
const told = JSON.parse(element("description").textContent);
const frames = told.times.length;

// -- data -------------------------------------------------------------------------------------------------

async function unpacked() {
  const packed = Uint8Array.from(atob(element("data").textContent.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const whole = new Int32Array(buffer, 0, told.integers);
  const bytes = new Uint8Array(buffer, 4 * told.integers);
  // Low bytes of all frames, then high bytes: each compresses better alone. Frames are told as differences.
  const row = 3 * told.vertices;
  const places = new Uint16Array(frames * row);
  for (let k = 0; k < places.length; k++) places[k] = bytes[k] | (bytes[places.length + k] << 8);
  for (let k = row; k < places.length; k++) places[k] += places[k - row]; // modulo 2^16
  const fields = told.fields.map((_, number) => bytes.subarray(2 * places.length + number * frames * told.vertices));
  return { whole, places, fields };
}

const { whole, places, fields } = await unpacked();
const part = ([first, count]) => whole.subarray(first, first + count);
const points = new Float32Array(3 * told.vertices);

function readPoints(frame) {
  const first = frame * points.length;
  for (let k = 0; k < points.length; k++) {
    points[k] = told.low[k % 3] + places[first + k] * told.step[k % 3];
  }
}

// -- colours ----------------------------------------------------------------------------------------------

const tones = told.colour_map.map((hex) => new THREE.Color(hex));

function toneOf(share) {
  const at = share * (tones.length - 1);
  const low = Math.min(Math.floor(at), tones.length - 2);
  return tones[low].clone().lerp(tones[low + 1], at - low);
}

const palette = Array.from({ length: 256 }, (_, k) => toneOf(k / 255));

// -- bodies -----------------------------------------------------------------------------------------------

function look(body) {
  const clear = body.opacity < 1;
  return { color: body.color, roughness: 0.62, opacity: body.opacity, transparent: clear, depthWrite: !clear };
}

class Surface {
  constructor(body) {
    this.source = part(body.source);
    this.positions = new THREE.BufferAttribute(new Float32Array(3 * this.source.length), 3);
    this.colours = new THREE.BufferAttribute(new Float32Array(3 * this.source.length), 3);
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute("position", this.positions);
    this.geometry.setAttribute("color", this.colours);
    this.geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(part(body.triangles)), 1));
    const side = body.open ? THREE.DoubleSide : THREE.FrontSide;
    this.material = new THREE.MeshStandardMaterial({ ...look(body), side });
    this.dark = this.material.clone();
    const [all, dark] = [body.triangles[1], 3 * body.dark];
    this.geometry.addGroup(0, all - dark, 0);
    this.geometry.addGroup(all - dark, dark, 1);
    this.meshes = [new THREE.Mesh(this.geometry, [this.material, this.dark])];
  }

  move() {
    this.source.forEach((vertex, k) => {
      for (let axis = 0; axis < 3; axis++) this.positions.array[3 * k + axis] = points[3 * vertex + axis];
    });
    this.positions.needsUpdate = true;
    this.geometry.computeVertexNormals();
  }

  paint(values) {
    this.source.forEach((vertex, k) => palette[values[vertex]].toArray(this.colours.array, 3 * k));
    this.colours.needsUpdate = true;
  }

  colourBy(isField, color) {
    const own = isField ? new THREE.Color(0xffffff) : color;
    this.material.color.copy(own);
    this.dark.color.copy(own);
    if (!isField) this.dark.color.multiplyScalar(told.darker ** 2.2); // of light, where Python darkens what is seen
    for (const material of [this.material, this.dark]) {
      material.vertexColors = isField;
      material.needsUpdate = true;
    }
  }
}

class Rods {
  // A cylinder for each edge, and a ball for each of their ends and for each loose vertex.
  constructor(body) {
    this.edges = part(body.edges);
    this.balls = part(body.balls);
    this.radii = new Map(Array.from(this.balls, (vertex, k) => [vertex, body.radii[k]]));
    this.material = new THREE.MeshStandardMaterial(look(body));
    const count = this.edges.length / 2;
    const cylinder = new THREE.CylinderGeometry(1, 1, 1, 12, 1, true);
    this.tubes = new THREE.InstancedMesh(cylinder, this.material, count);
    this.joints = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 12, 8), this.material, this.balls.length);
    this.meshes = [this.tubes, this.joints];
  }

  move() {
    const [start, end, way, size, up] = Array.from({ length: 5 }, () => new THREE.Vector3());
    const [turn, matrix] = [new THREE.Quaternion(), new THREE.Matrix4()];
    up.set(0, 1, 0); // along which three.js builds a cylinder
    for (let k = 0; k < this.edges.length / 2; k++) {
      const [a, b] = [this.edges[2 * k], this.edges[2 * k + 1]];
      start.fromArray(points, 3 * a);
      end.fromArray(points, 3 * b);
      way.subVectors(end, start);
      const radius = 0.5 * (this.radii.get(a) + this.radii.get(b));
      size.set(radius, way.length(), radius);
      turn.setFromUnitVectors(up, way.normalize());
      this.tubes.setMatrixAt(k, matrix.compose(start.add(end).multiplyScalar(0.5), turn, size));
    }
    turn.identity();
    this.balls.forEach((vertex, k) => {
      start.fromArray(points, 3 * vertex);
      this.joints.setMatrixAt(k, matrix.compose(start, turn, size.setScalar(this.radii.get(vertex))));
    });
    for (const mesh of this.meshes) mesh.instanceMatrix.needsUpdate = true;
  }

  paint(values) {
    for (let k = 0; k < this.edges.length / 2; k++) this.tubes.setColorAt(k, palette[values[this.edges[2 * k]]]);
    this.balls.forEach((vertex, k) => this.joints.setColorAt(k, palette[values[vertex]]));
    for (const mesh of this.meshes) if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
  }

  colourBy(isField, color) {
    this.material.color.copy(isField ? new THREE.Color(0xffffff) : color);
    if (!isField) for (const mesh of this.meshes) mesh.instanceColor = null;
    this.material.needsUpdate = true;
  }
}

class Body {
  constructor(body) {
    this.color = new THREE.Color(body.color);
    this.shapes = [];
    if (body.triangles[1]) this.shapes.push(new Surface(body));
    if (body.balls[1]) this.shapes.push(new Rods(body));
    this.object = new THREE.Group();
    for (const mesh of this.shapes.flatMap((shape) => shape.meshes)) {
      mesh.castShadow = mesh.receiveShadow = body.opacity === 1;
      mesh.frustumCulled = false; // its bounds are those of the first frame
      this.object.add(mesh);
    }
  }

  show(frame, field) {
    for (const shape of this.shapes) {
      shape.move();
      if (field >= 0) shape.paint(fields[field].subarray(frame * told.vertices));
    }
  }

  colourBy(field) {
    for (const shape of this.shapes) shape.colourBy(field >= 0, this.color);
  }
}

// -- the scene --------------------------------------------------------------------------------------------

const diagonal = told.diagonal;
const middle = new THREE.Vector3(...told.middle);
const scene = new THREE.Scene();
const camera = new THREE.PerspectiveCamera(30, 1, 1e-3 * diagonal, 60 * diagonal);
camera.up.set(0, 0, 1);
const renderer = new THREE.WebGLRenderer({ canvas: element("scene"), antialias: true, alpha: true });
renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
renderer.shadowMap.enabled = true;
renderer.localClippingEnabled = true;
const controls = new OrbitControls(camera, renderer.domElement);

function addLights() {
  scene.add(new THREE.HemisphereLight(0xffffff, 0xb8bcc6, 1.9));
  const sun = new THREE.DirectionalLight(0xffffff, 2.1);
  sun.position.copy(middle).add(new THREE.Vector3(-0.4, -0.5, 1.2).multiplyScalar(2 * diagonal));
  sun.target.position.copy(middle);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.bias = -5e-4;
  sun.shadow.normalBias = 2e-3 * diagonal;
  sun.shadow.radius = 6;
  const reach = 0.75 * diagonal;
  Object.assign(sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach });
  Object.assign(sun.shadow.camera, { near: 0.5 * diagonal, far: 6 * diagonal });
  scene.add(sun, sun.target);
}

function groundLines(spacing, height) {
  // Short pieces, fixed to the world, that fade away from the middle.
  const count = Math.ceil((2.4 * diagonal) / spacing);
  const snapped = [middle.x, middle.y].map((x) => spacing * Math.round(x / spacing));
  const [ends, colours] = [[], []];
  const add = (x, y) => {
    const away = Math.hypot(x - middle.x, y - middle.y) / (2.4 * diagonal);
    ends.push(x, y, height);
    colours.push(0.45, 0.5, 0.58, 0.45 * Math.max(0, 1 - away));
  };
  for (let k = -count; k <= count; k++) {
    for (let l = -count; l < count; l++) {
      const [across, from, to] = [k * spacing, l * spacing, (l + 1) * spacing];
      for (const along of [from, to]) add(snapped[0] + across, snapped[1] + along);
      for (const along of [from, to]) add(snapped[0] + along, snapped[1] + across);
    }
  }
  const shape = new THREE.BufferGeometry();
  shape.setAttribute("position", new THREE.Float32BufferAttribute(ends, 3));
  shape.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
  return new THREE.LineSegments(shape, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true }));
}

function addGround() {
  const lines = groundLines(told.ground.spacing, told.ground.height - 1e-3 * diagonal);
  const shape = new THREE.PlaneGeometry(5 * diagonal, 5 * diagonal);
  const shade = new THREE.Mesh(shape, new THREE.ShadowMaterial({ opacity: 0.22, depthWrite: false }));
  shade.position.set(middle.x, middle.y, told.ground.height - 5e-4 * diagonal);
  shade.receiveShadow = true;
  scene.add(lines, shade);
  return [lines, shade];
}

function addPlane(plane) {
  const shape = new THREE.PlaneGeometry(plane.size, plane.size);
  const material = new THREE.MeshStandardMaterial({ color: 0xd4d8df, side: THREE.DoubleSide, transparent: true });
  material.opacity = 0.7;
  if (told.ground) material.clippingPlanes = [new THREE.Plane(new THREE.Vector3(0, 0, 1), -told.ground.height)];
  const mesh = new THREE.Mesh(shape, material);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3(...plane.normal));
  mesh.position.set(...plane.middle);
  mesh.receiveShadow = true;
  scene.add(mesh);
  return [mesh];
}

addLights();
const bodies = told.bodies.map((body) => new Body(body));
bodies.forEach((body) => scene.add(body.object));

function addSwitch(name, color, objects) {
  const label = document.createElement("label");
  const box = document.createElement("input");
  const swatch = document.createElement("span");
  box.type = "checkbox";
  box.checked = true;
  swatch.className = "swatch";
  swatch.style.background = color;
  box.addEventListener("change", () => {
    for (const object of objects) object.visible = box.checked;
    draw();
  });
  label.append(box, swatch, name);
  element("list").append(label);
}

told.bodies.forEach((body, k) => addSwitch(body.name, body.color, [bodies[k].object]));
for (const plane of told.planes) addSwitch(plane.name, "#d4d8df", addPlane(plane));
if (told.ground) addSwitch(told.ground.name, "#f2f3f6", addGround());

// -- what is shown ----------------------------------------------------------------------------------------

let shown = -1;
let field = -1; // by body

function draw() {
  renderer.render(scene, camera);
}

function show(frame) {
  if (frame !== shown) {
    shown = frame;
    readPoints(frame);
    bodies.forEach((body) => body.show(frame, field));
    element("slider").value = frame;
    element("label").textContent =
      `frame ${told.numbers[frame]} of ${told.numbers[frames - 1]}, ${told.times[frame].toFixed(3)} s`;
  }
  draw();
}

function colourBy(chosen) {
  field = chosen;
  bodies.forEach((body) => body.colourBy(field));
  element("legend").hidden = field < 0;
  if (field >= 0) {
    element("low").textContent = told.fields[field].low.toPrecision(3);
    element("high").textContent = told.fields[field].high.toPrecision(3);
    element("unit").textContent = told.fields[field].unit;
  }
  const now = shown;
  shown = -1;
  show(now);
}

function resize() {
  const [width, height] = [window.innerWidth, window.innerHeight];
  renderer.setSize(width, height);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  draw();
}

function placeCamera() {
  // The file's camera is fitted to a picture of 4:3. What is below lies under the slider, and narrower windows see less.
  const height = window.innerHeight - 120;
  const away = (window.innerHeight / height) * Math.max(1, 4 / 3 / (window.innerWidth / height));
  controls.target.set(...told.camera.focus);
  camera.position.set(...told.camera.eye).sub(controls.target).multiplyScalar(away).add(controls.target);
  controls.update();
}

// -- time -------------------------------------------------------------------------------------------------

let playing = false;
let clock = 0; // of the motion [s]
let before = 0; // of the page [ms]

function play(yes) {
  playing = yes && frames > 1;
  element("play").textContent = playing ? "pause" : "play";
  if (!playing) return;
  clock = shown === frames - 1 ? told.times[0] : told.times[shown];
  before = performance.now();
  requestAnimationFrame(advance);
}

function advance(now) {
  if (!playing) return;
  clock += (1e-3 * (now - before)) * Number(element("speed").value);
  before = now;
  let frame = 0;
  while (frame + 1 < frames && told.times[frame + 1] <= clock) frame++;
  show(frame);
  if (frame === frames - 1) play(false);
  else requestAnimationFrame(advance);
}

function step(by) {
  play(false);
  show(Math.min(Math.max(shown + by, 0), frames - 1));
}

// -- the page ---------------------------------------------------------------------------------------------

element("note").textContent = told.note;
element("slider").max = frames - 1;
told.fields.forEach((one, k) => element("colour").append(new Option(`by ${one.name.replaceAll("_", " ")}`, k)));
const bar = element("bar").getContext("2d");
palette.forEach((tone, k) => {
  bar.fillStyle = `#${tone.getHexString()}`;
  bar.fillRect(k, 0, 1, 1);
});
element("colour").addEventListener("change", (event) => colourBy(event.target.value === "" ? -1 : Number(event.target.value)));
element("slider").addEventListener("input", (event) => {
  play(false);
  show(Number(event.target.value));
});
element("play").addEventListener("click", () => play(!playing));
window.addEventListener("keydown", (event) => {
  if (["INPUT", "SELECT", "BUTTON"].includes(event.target.tagName)) return;
  if (event.key === " ") play(!playing);
  else if (event.key === "ArrowRight") step(1);
  else if (event.key === "ArrowLeft") step(-1);
});
window.addEventListener("resize", resize);
controls.addEventListener("change", draw);
bodies.forEach((body) => body.colourBy(field));
show(0); // first, because three.js compiles what it draws for the attributes that are there
placeCamera();
resize();
document.body.dataset.ready = "yes";
