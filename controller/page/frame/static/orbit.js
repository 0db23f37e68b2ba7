// A drawing in three dimensions that a person turns: by mouse, one finger, two fingers, keys.
import {
  AmbientLight, DirectionalLight, PerspectiveCamera, Scene, Vector3, WebGLRenderer,
} from "/static/three/three.module.min.js";

export class OrbitView {
  // `turn` is where it is seen from at first, `nearest` and `farthest` bound its distance [mm].
  constructor(canvas, { target, turn, nearest, farthest, lowest = -0.1 }) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new Scene();
    this.scene.add(new AmbientLight(0xffffff, 1.6));
    this.sun = new DirectionalLight(0xffffff, 2.2);
    this.sun.position.set(600, -900, 1500);
    this.scene.add(this.sun);
    this.camera = new PerspectiveCamera(38, 4 / 3, nearest / 40, 2 * farthest);
    this.camera.up.set(0, 0, 1);
    this.target = new Vector3(...target);
    this.turn = turn;
    this.bounds = { nearest, farthest, lowest };
    this.watching = new ResizeObserver(() => this.fit());
    this.watching.observe(canvas);
    this.listen();
    this.fit();
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
      const { geometries, textures } = this.renderer.info.memory;
      this.canvas.dataset.held = `${geometries} ${textures}`; // by the graphics card, for this drawing
      this.canvas.dataset.drawn = String(Number(this.canvas.dataset.drawn || 0) + 1);
    });
  }

  // Takes something out of the drawing for good: what the graphics card has of it is given back, but
  // for what another drawing of it still shows.
  drop(thing) {
    if (!thing) return;
    thing.removeFromParent();
    const kept = new Set();
    this.scene.traverse((one) => { if (one.geometry) kept.add(one.geometry); });
    thing.traverse(({ geometry, material }) => {
      if (geometry && !kept.has(geometry)) geometry.dispose();
      for (const one of [material].flat().filter(Boolean)) {
        if (one.map) one.map.dispose();
        one.dispose();
      }
    });
  }

  // Ends the drawing; its canvas shows nothing afterwards.
  end() {
    this.watching.disconnect();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.draw = () => {};
  }

  by(azimuth, elevation, factor) {
    this.turn.azimuth += azimuth;
    this.turn.elevation = Math.min(1.5, Math.max(this.bounds.lowest, this.turn.elevation + elevation));
    this.turn.distance = Math.min(this.bounds.farthest, Math.max(this.bounds.nearest, this.turn.distance * factor));
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
