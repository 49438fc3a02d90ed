// The joint in space: silicone that twists and bends, head, lever, and tendons coloured by their tension.
//
// The head stands as the bench's sensors say: twisted about the axis first, then swung. The silicone is drawn as if its
// rotation vector grew evenly from base plate to head plate, an arc where it only bends: sections at share s are turned
// by exp(s u), where exp(u) is the head. Really it is softer where it is bent most. The plates' centres are as far apart
// as the tendons, whose mean is their distance, tell. Of frame B x points up here, y to the right, z to the back.

import { Bins, css } from "./scope.js";
import { risingZeros } from "./oscilloscope.js";

const RINGS = 14;

function mixed(THREE, share) {
  const [low, mid, high] = ["--low", "--mid", "--high"].map((name) => new THREE.Color(css(name)));
  return share < 0.5 ? low.lerp(mid, 2 * share) : mid.lerp(high, 2 * share - 1);
}

const KEYS = ["torsion", "drive", "pitch", "roll", "shortening"], SLOW = 10, PERIODS = 2, LABEL_MS = 200, EVERY_MS = 60, TURN = Math.PI / 18, MOST = 0.9 * Math.PI;

// The joint in its card: turned by mouse, touch and keys, its deformation drawn larger than it is, tensions as numbers,
// and its last periods slowly.
export class JointView {
  // component: NiceGUI's scene. traces: of the stream, whose newest seconds are shown slowly. eye: where it is seen from
  // at first, which the scene itself may not know yet.
  constructor(component, traces, eye) {
    Object.assign(this, { component, traces, factor: 1, isFresh: true, slow: null, every: EVERY_MS, drawn: 0, isSeen: true, mean: { pitch: 0, roll: 0 } });
    this.box = document.getElementById("sinew-joint");
    const slider = document.getElementById("sinew-exaggeration"), slowly = document.getElementById("sinew-slow");
    slider.addEventListener("input", () => {
      this.factor = Number(slider.value);
      slider.setAttribute("aria-valuetext", `${slider.value} times`);
      document.getElementById("sinew-exaggeration-said").textContent = `${slider.value}×`;
      this.isFresh = true;
    });
    slowly.addEventListener("click", () => {
      this.slow = this.slow ? null : { at: 0, periods: null };
      slowly.setAttribute("aria-pressed", String(this.slow !== null));
    });
    this.box.addEventListener("keydown", (event) => this.key(event));
    // The wheel scrolls the page, unless the joint has the focus or Ctrl is held, as it does over the oscilloscope.
    this.box.addEventListener("wheel", (event) => { if (!event.ctrlKey && !this.box.contains(document.activeElement)) event.stopPropagation(); }, true);
    document.getElementById("sinew-joint-home").addEventListener("click", () => this.home());
    this.fov = component.camera.fov;
    new ResizeObserver(() => this.fit()).observe(this.box);
    new IntersectionObserver(([one]) => { this.isSeen = one.isIntersecting; }).observe(this.box);
    this.fit();
    this.start = component.camera.position.clone().set(...eye);
    this.drawWhenNew();
  }

  // Fills the card; a narrow one sees as much across as a square one.
  fit() {
    const { camera } = this.component, { clientWidth: width, clientHeight: height } = this.box, aspect = width / Math.max(1, height), half = Math.tan(this.fov * Math.PI / 360);
    Object.assign(this, { width, height });
    camera.fov = aspect < 1 ? 360 / Math.PI * Math.atan(half / aspect) : this.fov;
    this.component.resize();
    this.isFresh = true;
  }

  // The oscilloscope goes first: where the page falls behind, the joint is drawn less often.
  yieldTo(rate) { this.every = rate < 27 ? Math.min(1000, 1.5 * this.every) : Math.max(EVERY_MS, 0.9 * this.every); }

  async show(rig) {
    this.joint?.remove();
    this.rig = rig;
    this.joint = await Joint.build(this.component, rig.shape);
    this.labels = this.joint.tendons.map(() => document.createElement("span"));
    document.getElementById("sinew-tensions").replaceChildren(...this.labels);
    this.isFresh = true;
  }

  // NiceGUI draws out of step with the oscilloscope, so that each of its pictures is one more of the page's; `paint`
  // draws instead, in every second one.
  drawWhenNew() {
    const { renderer, camera, scene } = this.component, draw = renderer.render.bind(renderer);
    this.seen = camera.matrixWorld.clone();
    this.drawScene = () => draw(scene, camera);
    renderer.render = () => {};
  }

  // Draws the joint where it or the camera moved, and is seen. withScope: whether the oscilloscope is drawn, too; only
  // who turns the joint need not wait for that.
  paint(at, withScope) {
    if (!this.isSeen || at - this.drawn < this.every - 5) return;
    const { camera } = this.component;
    camera.updateMatrixWorld();
    const isTurned = !this.seen.equals(camera.matrixWorld);
    if (!isTurned && !(this.isFresh && withScope)) return;
    this.seen.copy(camera.matrixWorld);
    this.drawn = at;
    this.isFresh = false;
    this.drawScene();
    this.place();
  }

  key(event) {
    const turns = { ArrowLeft: [-TURN, 0, 1], ArrowRight: [TURN, 0, 1], ArrowUp: [0, -TURN, 1], ArrowDown: [0, TURN, 1],
      "+": [0, 0, 0.9], "=": [0, 0, 0.9], "-": [0, 0, 1 / 0.9] };
    const { camera, controls } = this.component;
    if (event.ctrlKey || event.altKey || event.metaKey || !(event.key in turns || event.key === "Home")) return;
    event.preventDefault();
    if (event.key === "Home") this.home();
    else {
      const [around, up, nearer] = turns[event.key], from = camera.position.clone().sub(controls.target);
      const long = from.length() * nearer, azimuth = Math.atan2(from.y, from.x) + around;
      const polar = Math.min(Math.PI - 0.05, Math.max(0.05, Math.acos(from.z / from.length()) + up));
      camera.position.set(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)).multiplyScalar(long).add(controls.target);
    }
    camera.lookAt(controls.target);
  }

  // It is seen from where it was at first.
  home() {
    const { camera, controls } = this.component;
    camera.position.copy(this.start);
    camera.lookAt(controls.target);
  }

  // now: newest value of each trace. at: time of the frame [ms].
  move(now, at) {
    if (!this.joint) return;
    const row = (key) => this.traces.traces.findIndex((trace) => trace.key === key);
    const values = this.slow ? this.slowly(row, at) : (key) => now[row(key)];
    if (!values) return;
    const given = [...KEYS, ...this.labels.map((_, i) => `tendon_${i + 1}_current`)].map(values), told = given.map((v) => v ?? 0);
    const is = `${this.factor} ${given.map((v) => v?.toFixed(2))}`;
    if (is === this.was) return;
    this.was = is;
    const [torsion, drive, pitch, roll, shortening, ...currents] = told, radians = (degrees) => degrees * Math.PI / 180;
    // The pose is drawn as it is, what sways about it larger.
    for (const [key, value] of [["pitch", pitch], ["roll", roll]]) this.mean[key] += Math.abs(value - this.mean[key]) > 5 ? value - this.mean[key] : 0.02 * (value - this.mean[key]);
    const sway = (key, value) => radians(this.mean[key] + this.factor * (value - this.mean[key]));
    const most = Math.max(this.rig.tension_limit_n, 1);
    this.tensions = currents.map((current) => Math.max(0, current) * this.rig.newton_per_ampere);
    this.known = given.slice(KEYS.length).map(Number.isFinite); // before a sample came no tension is known, 0 N neither
    this.joint.pose(Math.min(MOST, Math.max(-MOST, this.factor * radians(torsion))), radians(drive), this.tensions.map((t) => t / most),
      [sway("pitch", pitch), sway("roll", roll)], shortening / this.rig.length_mm);
    this.isFresh = true;
  }

  // The last periods of the lever, a tenth as fast, again and again; those that are newest when they begin.
  slowly(row, at) {
    const { slow, traces } = this, long = slow.periods ? slow.periods.time.at(-1) - slow.periods.time[0] : 0;
    slow.at += Math.min(0.2, (at - (slow.last ?? at)) / 1000) / SLOW;
    slow.last = at;
    if (!slow.periods || slow.at >= long) { slow.periods = lastPeriods(traces, row("drive")); slow.at = 0; }
    if (!slow.periods) return null;
    const { time, rows } = slow.periods, when = time[0] + slow.at;
    const k = Math.min(Math.max(1, time.findIndex((t) => t >= when)), time.length - 1), share = (when - time[k - 1]) / (time[k] - time[k - 1]);
    return (key) => row(key) < 0 ? 0 : rows[row(key)][k - 1] + share * (rows[row(key)][k] - rows[row(key)][k - 1]);
  }

  // Puts each tension beside its tendon.
  place() {
    if (!this.tensions || !this.joint) return;
    const { camera } = this.component, { width, height } = this, now = performance.now();
    const isDue = now - (this.said ?? -LABEL_MS) >= LABEL_MS;
    if (isDue) this.said = now;
    this.joint.tendons.forEach((tendon, i) => {
      const point = tendon.position.clone(), behind = point.distanceTo(camera.position) > camera.position.distanceTo(this.component.controls.target);
      point.x *= 1.25; point.y *= 1.25;
      point.project(camera);
      const label = this.labels[i];
      if (!width || !Number.isFinite(point.x)) { label.textContent = ""; return; } // it is not drawn yet
      label.style.transform = `translate(-50%, -50%) translate(${((point.x + 1) / 2 * width).toFixed(1)}px, ${((1 - point.y) / 2 * height).toFixed(1)}px)`;
      label.style.zIndex = behind ? "0" : "1";
      if (isDue) label.textContent = `${i + 1}: ${this.known[i] ? `${this.tensions[i].toFixed(0)} N` : "–"}`;
    });
  }
}

// {time, rows} of the last periods of a trace in the stream; of the last two seconds where it does not swing.
function lastPeriods(traces, row) {
  const bins = new Bins(traces.traces.map((trace) => trace.key), 4096);
  for (let k = traces.from(traces.newest - 4); k < traces.count; k++) {
    const i = k % traces.time.length;
    bins.add(traces.time[i], traces.low, traces.high, i, bins.keys.length);
  }
  if (bins.count < 8) return null;
  const zeros = row < 0 ? [] : risingZeros(bins, row), swings = zeros.length > PERIODS;
  const first = bins.from(swings ? zeros.at(-1 - PERIODS) : traces.newest - 2), last = swings ? bins.from(zeros.at(-1)) : bins.count;
  if (last - first < 4) return null;
  const middle = (c) => Array.from({ length: last - first }, (_, k) => (bins.low[c][first + k] + bins.high[c][first + k]) / 2);
  return { time: Array.from(bins.time.slice(first, last)), rows: bins.keys.map((_, c) => middle(c)) };
}

export class Joint {
  // shape: {length, outline, circle, plate, lever, tendons}, in units of the silicone's length; outline: points [right,
  // back] around a section, evenly by angle.
  static async build(component, shape) {
    const { THREE } = await import("nicegui-scene");
    return new Joint(THREE, component, shape);
  }

  constructor(THREE, component, shape) {
    Object.assign(this, { THREE, component, shape });
    const plate = (radius, height, colour) => new THREE.Mesh(
      new THREE.CylinderGeometry(radius, radius, height, 40).rotateX(Math.PI / 2), new THREE.MeshPhongMaterial({ color: colour }));
    this.root = new THREE.Group();
    const base = plate(shape.plate, 0.08, "#78838f");
    base.position.z = -0.04;
    this.silicone = this.twisting();
    this.head = new THREE.Group();
    this.head.position.z = shape.length;
    const top = plate(shape.plate, 0.08, "#8d98a3");
    top.position.z = 0.04;
    const mark = new THREE.Mesh(new THREE.BoxGeometry(shape.plate, 0.05, 0.03), new THREE.MeshPhongMaterial({ color: "#0072b2" }));
    mark.position.set(shape.plate / 2, 0, 0.09);
    this.lever = new THREE.Group();
    this.lever.position.z = 0.22;
    this.head.add(top, mark, this.lever);
    const bar = new THREE.Mesh(new THREE.BoxGeometry(2 * shape.lever, 0.09, 0.05), new THREE.MeshPhongMaterial({ color: "#d98a2b" }));
    this.lever.add(bar);
    for (const side of [-1, 1]) {
      const weight = plate(0.13, 0.16, "#b35900");
      weight.position.x = side * shape.lever;
      this.lever.add(weight);
    }
    this.tendons = Array.from({ length: shape.tendons }, () => {
      const tendon = new THREE.Mesh(new THREE.CylinderGeometry(0.028, 0.028, 1, 10), new THREE.MeshPhongMaterial());
      // What the bulging silicone of a bent joint hides of a chord is seen through it.
      const ghost = new THREE.Mesh(tendon.geometry, new THREE.MeshBasicMaterial({
        blending: THREE.CustomBlending, blendSrcAlpha: THREE.OneFactor, blendDstAlpha: THREE.OneMinusSrcAlphaFactor,
        opacity: 0.4, depthTest: false, depthWrite: false }));
      ghost.renderOrder = 1;
      tendon.add(ghost);
      this.root.add(tendon);
      return tendon;
    });
    this.root.add(base, this.silicone, this.head);
    // First the silicone, then what shines through it, then all that hides both: so plates stay opaque.
    this.root.traverse((part) => { if (part.isMesh && part !== this.silicone && !part.renderOrder) part.renderOrder = 2; });
    component.scene.add(this.root);
    component.renderer.setClearColor(0x000000, 0);
    this.pose(0, 0, []);
  }

  remove() { this.component.scene.remove(this.root); }

  twisting() {
    const { THREE, shape } = this, sides = shape.outline.length;
    const geometry = new THREE.CylinderGeometry(1, 1, shape.length, sides, RINGS, true).rotateX(Math.PI / 2);
    geometry.translate(0, 0, shape.length / 2);
    this.rest = geometry.attributes.position.array.slice();
    this.normals = geometry.attributes.normal.array.slice();
    const point = (k) => shape.outline[(k + sides) % sides];
    const colours = [], light = new THREE.Color("#e9dfc9"), dark = new THREE.Color("#bfa877");
    for (let i = 0; i < this.rest.length; i += 3) {
      const k = Math.round(Math.atan2(this.rest[i + 1], this.rest[i]) / (2 * Math.PI) * sides);
      const [before, here, after] = [point(k - 1), point(k), point(k + 1)];
      const along = [after[0] - before[0], after[1] - before[1]], long = Math.hypot(...along);
      this.rest.set(here, i);
      this.normals.set([along[1] / long, -along[0] / long, 0], i);
      const colour = k % 4 === 0 ? dark : light;
      colours.push(colour.r, colour.g, colour.b);
    }
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
    return new THREE.Mesh(geometry, new THREE.MeshPhongMaterial({ vertexColors: true, side: THREE.DoubleSide }));
  }

  // torsion, drive [rad]; shares: of the limit of each tendon's tension, 0 to 1; swing: pitch and roll of a bent head
  // [rad]; nearer: by how much the plates have come together, in lengths of the silicone.
  pose(torsion, drive, shares, [pitch, roll] = [0, 0], nearer = 0) {
    const { THREE, shape } = this;
    const swing = Math.hypot(pitch, roll), axis = swing > 1e-9 ? new THREE.Vector3(pitch / swing, roll / swing, 0) : UP(THREE);
    const head = new THREE.Quaternion().setFromAxisAngle(axis, swing).multiply(new THREE.Quaternion().setFromAxisAngle(UP(THREE), torsion));
    const section = sections(THREE, head), reach = section(1).place.length();
    const long = Math.max(0.5, shape.length - nearer) / reach;
    this.bend(section, long);
    const top = section(1).place.multiplyScalar(long);
    this.head.quaternion.copy(head);
    this.head.position.copy(top);
    this.lever.rotation.z = drive;
    const up = new THREE.Vector3(0, 1, 0);
    this.tendons.forEach((tendon, i) => {
      const angle = 2 * Math.PI * i / shape.tendons, r = shape.circle;
      const foot = new THREE.Vector3(r * Math.cos(angle), r * Math.sin(angle), 0);
      const guide = foot.clone().applyQuaternion(head).add(top);
      const along = guide.clone().sub(foot);
      tendon.scale.y = along.length();
      tendon.quaternion.setFromUnitVectors(up, along.clone().normalize());
      tendon.position.copy(foot.add(guide).multiplyScalar(0.5));
      tendon.material.color = mixed(THREE, Math.min(1, Math.max(0, shares[i] ?? 0)));
      tendon.children[0].visible = swing > 1e-9;
      tendon.children[0].material.color = tendon.material.color;
    });
  }

  // Puts every ring of the silicone where its section is; a ring's points lie behind one another.
  bend(section, long) {
    const { THREE, shape, rest, normals } = this, { position, normal } = this.silicone.geometry.attributes;
    const point = new THREE.Vector3(), sides = shape.outline.length;
    for (let ring = 0; ring <= RINGS; ring++) {
      const first = ring * (sides + 1), { turn, place } = section(rest[3 * first + 2] / shape.length);
      for (let i = first; i <= first + sides; i++) {
        point.set(rest[3 * i], rest[3 * i + 1], 0).applyQuaternion(turn).addScaledVector(place, long).toArray(position.array, 3 * i);
        point.fromArray(normals, 3 * i).applyQuaternion(turn).toArray(normal.array, 3 * i);
      }
    }
    position.needsUpdate = normal.needsUpdate = true;
  }
}

const UP = (THREE) => new THREE.Vector3(0, 0, 1);

// Of a rod of length one with an even rotation vector u, exp(u) = head: {turn, place} of the section at share s.
function sections(THREE, head) {
  const q = head.w < 0 ? new THREE.Quaternion(-head.x, -head.y, -head.z, -head.w) : head;
  const sine = Math.hypot(q.x, q.y, q.z), angle = 2 * Math.atan2(sine, q.w);
  const axis = sine > 1e-9 ? new THREE.Vector3(q.x, q.y, q.z).divideScalar(sine) : UP(THREE);
  const across = axis.clone().cross(UP(THREE));
  return (share) => {
    const turned = share * angle, turn = new THREE.Quaternion().setFromAxisAngle(axis, turned);
    const place = UP(THREE).multiplyScalar(share);
    if (angle > 1e-6) {
      const a = Math.sin(turned) / angle;
      place.set(0, 0, a).addScaledVector(across, (1 - Math.cos(turned)) / angle).addScaledVector(axis, (share - a) * axis.z);
    }
    return { turn, place };
  };
}
