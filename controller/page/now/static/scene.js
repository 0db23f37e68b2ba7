// The cell in three dimensions, by three.js: boxes of the collision checks, the part's mesh, camera cones.
import {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, Color, DirectionalLight, EdgesGeometry,
  GridHelper, Group, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshLambertMaterial,
  PerspectiveCamera, Scene, Vector3, WebGLRenderer,
} from "/static/three/three.module.min.js";

const COLOURS = {
  arm: 0x788ca3, gripper: 0x56677d, finger: 0xe4963c, fixed: 0x58847a, "fixed finger": 0x2ea896,
  obstacle: 0xbabcbe, "tray accept": 0x96cdaa, "tray reject": 0xe2a08c, "tray quarantine": 0xead282,
  part: 0x3d7ab8,
};
const matrix = (T) => new Matrix4().set(...T);

export class CellView {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new Scene();
    this.scene.add(new AmbientLight(0xffffff, 1.6));
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(600, -900, 1500);
    this.scene.add(sun);
    this.camera = new PerspectiveCamera(38, 4 / 3, 10, 12000);
    this.camera.up.set(0, 0, 1);
    this.target = new Vector3(330, 0, 250);
    this.turn = { azimuth: -0.75, elevation: 0.5, distance: 2300 };
    this.cell = null;
    this.moving = [];
    this.part = null;
    this.ghost = false;
    new ResizeObserver(() => this.fit()).observe(canvas);
    this.listen();
    this.fit();
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

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      const { azimuth, elevation, distance } = this.turn;
      this.camera.position.set(
        this.target.x + distance * Math.cos(elevation) * Math.cos(azimuth),
        this.target.y + distance * Math.cos(elevation) * Math.sin(azimuth),
        this.target.z + distance * Math.sin(elevation),
      );
      this.camera.lookAt(this.target);
      this.renderer.render(this.scene, this.camera);
      this.canvas.dataset.drawn = String(Number(this.canvas.dataset.drawn || 0) + 1);
    });
  }

  by(azimuth, elevation, factor) {
    this.turn.azimuth += azimuth;
    this.turn.elevation = Math.min(1.5, Math.max(-0.1, this.turn.elevation + elevation));
    this.turn.distance = Math.min(6000, Math.max(400, this.turn.distance * factor));
    this.draw();
  }

  listen() {
    const fingers = new Map();
    let spread = 0;
    const apart = () => {
      const [a, b] = [...fingers.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 2) spread = apart();
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 1) this.by((before.x - event.clientX) * 0.008, (event.clientY - before.y) * 0.006, 1);
      else if (fingers.size === 2 && spread) {
        const now = apart();
        this.by(0, 0, spread / now);
        spread = now;
      }
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
    }
    this.canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== this.canvas) return; // the page scrolls
      event.preventDefault();
      this.by(0, 0, event.deltaY > 0 ? 1.1 : 0.9);
    }, { passive: false });
    const keys = {
      ArrowLeft: [-0.12, 0, 1], ArrowRight: [0.12, 0, 1], ArrowUp: [0, 0.08, 1], ArrowDown: [0, -0.08, 1],
      "+": [0, 0, 0.9], "-": [0, 0, 1.1],
    };
    this.canvas.addEventListener("keydown", (event) => {
      if (!(event.key in keys)) return;
      event.preventDefault();
      this.by(...keys[event.key]);
    });
  }
}
