// The cell in three dimensions, by three.js: boxes of the collision checks, the part's mesh, camera cones.
import {
  BoxGeometry, BufferAttribute, BufferGeometry, Color, ConeGeometry, EdgesGeometry, GridHelper, Group,
  Line, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, Vector3,
} from "/static/three/three.module.min.js";
import { OrbitView } from "/static/orbit.js";

const COLOURS = {
  arm: 0x788ca3, gripper: 0x56677d, finger: 0xe4963c, fixed: 0x58847a, "fixed finger": 0x2ea896,
  obstacle: 0xbabcbe, "tray accept": 0x96cdaa, "tray reject": 0xe2a08c, "tray quarantine": 0xead282,
  part: 0x3d7ab8,
};
// Of a motion that is previewed: how dense the arm is at each stop, the last being its end.
const GHOST_OPACITIES = [0.1, 0.16, 0.38];
const GHOST_COLOUR = 0xb0480a;
const STANDS_STILL = ["fixed", "fixed finger"];
const matrix = (T) => new Matrix4().set(...T);

export class CellView extends OrbitView {
  constructor(canvas) {
    const turn = { azimuth: -0.75, elevation: 0.5, distance: 2600 };
    super(canvas, { target: [330, 0, 330], turn, nearest: 400, farthest: 6000 });
    this.cell = null;
    this.moving = [];
    this.part = null;
    this.ghost = null;
    this.kinds = [];
  }

  // Draws what stands in the cell, and the part's mesh, if there is one.
  async load(mesh) {
    const reply = await fetch("/now/scene", { credentials: "same-origin" });
    if (!reply.ok) throw new Error((await reply.json()).error);
    const found = await reply.json();
    this.preview(null);
    this.drop(this.cell);
    this.cell = new Group();
    for (const box of found.boxes) this.cell.add(this.box(box, matrix(box.T), box.kind === "obstacle" ? 0.45 : 1));
    for (const camera of found.cameras) this.cell.add(this.cone(camera));
    const grid = new GridHelper(1400, 14, 0x8896a4, 0x8896a4);
    grid.rotateX(Math.PI / 2);
    grid.position.set(350, 0, -1);
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    this.cell.add(grid);
    this.kinds = found.moving;
    this.moving = found.moving.map((one) => {
      const made = this.box(one, new Matrix4(), 1);
      this.cell.add(made);
      return made;
    });
    this.part = null;
    this.scene.add(this.cell);
    if (mesh.vertices) {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(new Float32Array(mesh.vertices), 3));
      geometry.setIndex(mesh.triangles);
      const flat = geometry.toNonIndexed();
      flat.computeVertexNormals();
      this.part = new Mesh(flat, new MeshLambertMaterial({ color: COLOURS.part }));
      this.part.matrixAutoUpdate = false;
      this.part.visible = false;
      this.cell.add(this.part);
    }
    this.draw();
  }

  box({ half, kind }, pose, opacity) {
    const geometry = new BoxGeometry(2 * half[0], 2 * half[1], 2 * half[2]);
    const color = COLOURS[kind] || 0xbabcbe;
    const material = new MeshLambertMaterial({ color, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
    const made = new Mesh(geometry, material);
    const edge = new LineBasicMaterial({ color: new Color(color).multiplyScalar(0.55), transparent: opacity < 1, opacity: Math.min(1, 2 * opacity) });
    made.add(new LineSegments(new EdgesGeometry(geometry), edge));
    made.matrixAutoUpdate = false;
    made.matrix.copy(pose);
    return made;
  }

  cone({ eye, corners }) {
    const points = [];
    corners.forEach((corner, k) => points.push(...eye, ...corner, ...corner, ...corners[(k + 1) % corners.length]));
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    return new LineSegments(geometry, new LineBasicMaterial({ color: 0xd08a1e }));
  }

  // Draws the arm along a motion that has not begun: at stops on its way, denser towards its end, and
  // the path of its TCP with an arrow. Null takes it away.
  preview(motion) {
    this.drop(this.ghost);
    this.ghost = null;
    if (motion && this.kinds.length) {
      this.ghost = new Group();
      motion.stops.forEach(({ T, part }, k) => {
        const opacity = GHOST_OPACITIES[k];
        T.forEach((pose, j) => {
          if (!STANDS_STILL.includes(this.kinds[j].kind)) this.ghost.add(this.box(this.kinds[j], matrix(pose), opacity));
        });
        if (part && this.part) {
          const held = new Mesh(this.part.geometry, new MeshLambertMaterial({ color: COLOURS.part, transparent: true, opacity, depthWrite: false }));
          held.matrixAutoUpdate = false;
          held.matrix.copy(matrix(part));
          this.ghost.add(held);
        }
      });
      this.ghost.add(this.arrow(motion.tcp.map((p) => new Vector3(...p))));
      this.scene.add(this.ghost);
    }
    this.canvas.dataset.preview = this.ghost ? "yes" : "no";
    this.draw();
  }

  arrow(points) {
    const made = new Group();
    made.add(new Line(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ color: GHOST_COLOUR, depthTest: false })));
    const end = points.at(-1);
    const from = points.findLast((p) => p.distanceTo(end) > 2);
    if (from) {
      const head = new Mesh(new ConeGeometry(9, 30, 12), new MeshBasicMaterial({ color: GHOST_COLOUR, depthTest: false }));
      const along = end.clone().sub(from).normalize();
      head.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), along);
      head.position.copy(end).addScaledVector(along, -15);
      made.add(head);
    }
    made.renderOrder = 2;
    return made;
  }

  show(moment) {
    moment.T.forEach((T, k) => {
      if (this.moving[k]) this.moving[k].matrix.copy(matrix(T));
    });
    if (this.part) {
      this.part.visible = Boolean(moment.part);
      if (moment.part) this.part.matrix.copy(matrix(moment.part));
    }
    this.draw();
  }
}
