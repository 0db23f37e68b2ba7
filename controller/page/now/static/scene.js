// The cell in three dimensions, by three.js: boxes of the collision checks, the part's mesh, camera cones.
import {
  BoxGeometry, BufferAttribute, BufferGeometry, Color, EdgesGeometry, GridHelper, Group,
  LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshLambertMaterial,
} from "/static/three/three.module.min.js";
import { OrbitView } from "/static/orbit.js";

const COLOURS = {
  arm: 0x788ca3, gripper: 0x56677d, finger: 0xe4963c, fixed: 0x58847a, "fixed finger": 0x2ea896,
  obstacle: 0xbabcbe, "tray accept": 0x96cdaa, "tray reject": 0xe2a08c, "tray quarantine": 0xead282,
  part: 0x3d7ab8,
};
const matrix = (T) => new Matrix4().set(...T);

export class CellView extends OrbitView {
  constructor(canvas) {
    const turn = { azimuth: -0.75, elevation: 0.5, distance: 2300 };
    super(canvas, { target: [330, 0, 250], turn, nearest: 400, farthest: 6000 });
    this.cell = null;
    this.moving = [];
    this.part = null;
  }

  async load() {
    const reply = await fetch("/now/scene", { credentials: "same-origin" });
    if (!reply.ok) throw new Error((await reply.json()).error);
    const found = await reply.json();
    if (this.cell) this.scene.remove(this.cell);
    this.cell = new Group();
    for (const box of found.boxes) this.cell.add(this.box(box, matrix(box.T), box.kind === "obstacle" ? 0.45 : 1));
    for (const camera of found.cameras) this.cell.add(this.cone(camera));
    const grid = new GridHelper(1400, 14, 0x8896a4, 0x8896a4);
    grid.rotateX(Math.PI / 2);
    grid.position.set(350, 0, -1);
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    this.cell.add(grid);
    this.moving = found.moving.map((one) => {
      const made = this.box(one, new Matrix4(), 1);
      this.cell.add(made);
      return made;
    });
    this.part = null;
    this.scene.add(this.cell);
    this.draw();
    const mesh = await (await fetch("/now/mesh", { credentials: "same-origin" })).json();
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
    made.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: new Color(color).multiplyScalar(0.55) })));
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
