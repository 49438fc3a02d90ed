// The joint in space: silicone that twists and bends, head, lever, and tendons coloured by their tension.
//
// The head stands as the bench's sensors say: twisted about the axis first, then swung. The silicone is drawn as if its
// rotation vector grew evenly from base plate to head plate, an arc where it only bends: sections at share s are turned
// by exp(s u), where exp(u) is the head. Really it is softer where it is bent most. The plates' centres are as far apart
// as the tendons, whose mean is their distance, tell. Of frame B x points up here, y to the right, z to the back.

import { css } from "./scope.js";

const RINGS = 14;

function mixed(THREE, share) {
  const [low, mid, high] = ["--low", "--mid", "--high"].map((name) => new THREE.Color(css(name)));
  return share < 0.5 ? low.lerp(mid, 2 * share) : mid.lerp(high, 2 * share - 1);
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
