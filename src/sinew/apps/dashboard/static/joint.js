// The joint in space: silicone that twists, head, lever, and tendons coloured by their tension.

import { css } from "./scope.js";

const RINGS = 14, SIDES = 28;

function mixed(THREE, share) {
  const [low, mid, high] = ["--low", "--mid", "--high"].map((name) => new THREE.Color(css(name)));
  return share < 0.5 ? low.lerp(mid, 2 * share) : mid.lerp(high, 2 * share - 1);
}

export class Joint {
  // shape: {length, radius, circle, plate, lever, tendons}, in units of the silicone's length.
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
    this.head.add(top, mark);
    this.lever = new THREE.Group();
    this.lever.position.z = shape.length + 0.22;
    const bar = new THREE.Mesh(new THREE.BoxGeometry(2 * shape.lever, 0.09, 0.05), new THREE.MeshPhongMaterial({ color: "#d98a2b" }));
    this.lever.add(bar);
    for (const side of [-1, 1]) {
      const weight = plate(0.13, 0.16, "#b35900");
      weight.position.x = side * shape.lever;
      this.lever.add(weight);
    }
    this.tendons = Array.from({ length: shape.tendons }, () => {
      const tendon = new THREE.Mesh(new THREE.CylinderGeometry(0.028, 0.028, 1, 10), new THREE.MeshPhongMaterial());
      this.root.add(tendon);
      return tendon;
    });
    this.root.add(base, this.silicone, this.head, this.lever);
    component.scene.add(this.root);
    component.renderer.setClearColor(0x000000, 0);
    this.pose(0, 0, []);
  }

  remove() { this.component.scene.remove(this.root); }

  twisting() {
    const { THREE, shape } = this;
    const geometry = new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, SIDES, RINGS, true).rotateX(Math.PI / 2);
    geometry.translate(0, 0, shape.length / 2);
    this.rest = geometry.attributes.position.array.slice();
    const colours = [], light = new THREE.Color("#e9dfc9"), dark = new THREE.Color("#bfa877");
    for (let i = 0; i < this.rest.length; i += 3) {
      const around = Math.atan2(this.rest[i + 1], this.rest[i]) / (2 * Math.PI) * SIDES;
      const colour = Math.round(around) % 4 === 0 ? dark : light;
      colours.push(colour.r, colour.g, colour.b);
    }
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 3));
    return new THREE.Mesh(geometry, new THREE.MeshPhongMaterial({ vertexColors: true, side: THREE.DoubleSide }));
  }

  // torsion, drive [rad]; tensions: [{share from 0 to 1}], of each tendon.
  pose(torsion, drive, shares) {
    const { shape, rest } = this;
    const position = this.silicone.geometry.attributes.position;
    for (let i = 0; i < rest.length; i += 3) {
      const turn = torsion * rest[i + 2] / shape.length, c = Math.cos(turn), s = Math.sin(turn);
      position.array[i] = c * rest[i] - s * rest[i + 1];
      position.array[i + 1] = s * rest[i] + c * rest[i + 1];
    }
    position.needsUpdate = true;
    this.head.rotation.z = torsion;
    this.lever.rotation.z = torsion + drive;
    const up = new this.THREE.Vector3(0, 1, 0);
    this.tendons.forEach((tendon, i) => {
      const angle = 2 * Math.PI * i / shape.tendons, r = shape.circle;
      const foot = new this.THREE.Vector3(r * Math.cos(angle), r * Math.sin(angle), 0);
      const head = new this.THREE.Vector3(r * Math.cos(angle + torsion), r * Math.sin(angle + torsion), shape.length);
      const along = head.clone().sub(foot);
      tendon.scale.y = along.length();
      tendon.quaternion.setFromUnitVectors(up, along.clone().normalize());
      tendon.position.copy(foot.add(head).multiplyScalar(0.5));
      tendon.material.color = mixed(this.THREE, Math.min(1, Math.max(0, shares[i] ?? 0)));
    });
  }
}
