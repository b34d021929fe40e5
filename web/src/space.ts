// Solids of a scene, by three.js: environment, arm, tool, hand. Forces and words are drawn over it (picture.ts).

import {
  Box3, BoxGeometry, BufferGeometry, CapsuleGeometry, CylinderGeometry, DirectionalLight, DoubleSide, EdgesGeometry, ExtrudeGeometry,
  Float32BufferAttribute, Group, HemisphereLight, LatheGeometry, LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial, Object3D,
  OrthographicCamera, Path, PCFSoftShadowMap, PlaneGeometry, Points, PointsMaterial, Quaternion, Scene, ShadowMaterial, Shape,
  ShapeGeometry, TorusGeometry, Vector2, Vector3, WebGLRenderer,
} from 'three';
import { ConvexGeometry } from 'three/examples/jsm/geometries/ConvexGeometry.js';
import { toCreasedNormals } from 'three/examples/jsm/utils/BufferGeometryUtils.js';

import type { Arm, Element, Introduction, Vec } from './channel';
import type { Attitude, Shown, View } from './picture';

const WALL_M = 0.16; // half of the part of a plane that is shown
const SKIN_M = 0.0012; // of a tool around its contact points
const LINK_M = 0.045; // radius of the arm's joints
const FINGER_M = 0.005; // radius
const SLOW_MS = 60; // between two frames
const SLOW_FRAMES = 30;
const AHEAD_M = 5; // of the camera
const CREASE = (25 * Math.PI) / 180; // a mesh has an edge there

const v3 = (p: readonly number[]): Vector3 => new Vector3(p[0], p[1], p[2]);
const quaternion = (q: Attitude): Quaternion => new Quaternion(q[1], q[2], q[3], q[0]);
const between = (from: Vector3, to: Vector3): Quaternion => new Quaternion().setFromUnitVectors(from, to.clone().normalize());
const Y = new Vector3(0, 1, 0), Z = new Vector3(0, 0, 1);
const colour = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** A cylinder from one point to another. */
function rod(from: Vector3, to: Vector3, radius: number, material: MeshLambertMaterial): Mesh {
  const along = to.clone().sub(from), mesh = solid(new CylinderGeometry(radius, radius, along.length(), 32), material);
  mesh.position.copy(from).addScaledVector(along, 0.5);
  mesh.quaternion.copy(between(Y, along));
  return mesh;
}
function solid(geometry: BufferGeometry, material: MeshLambertMaterial): Mesh {
  const mesh = new Mesh(geometry, material);
  mesh.castShadow = mesh.receiveShadow = true;
  return mesh;
}
function edges(of: BufferGeometry, line: string): LineSegments {
  return new LineSegments(new EdgesGeometry(of, 25), new LineBasicMaterial({ color: line, transparent: true, opacity: 0.6 }));
}

/** A shape with edges; null: it has none of its own, as a spring. */
function shapeOf(e: Element, material: MeshLambertMaterial, line: string): Object3D | null {
  const put = (geometry: BufferGeometry, at: readonly number[], turn = new Quaternion(), lines = true): Mesh => {
    const mesh = solid(geometry, material);
    mesh.position.copy(v3(at));
    mesh.quaternion.copy(turn);
    if (lines) mesh.add(edges(geometry, line));
    return mesh;
  };
  switch (e.kind) {
    case 'sphere':
      return put(new CapsuleGeometry(e.radius_m, 0, 16, 48), e.center_m!, new Quaternion(), false);
    case 'box':
      return put(new BoxGeometry(...(e.half_size_m!.map((h) => 2 * h) as Vec)), e.center_m!);
    case 'cylinder':
      return put(new CylinderGeometry(e.radius_m, e.radius_m, 2, 64, 1, true), e.point_m!, between(Y, v3(e.axis!)), false);
    case 'torus':
      return put(new TorusGeometry(e.radius_m, e.tube_radius_m, 24, 64), e.center_m!, between(Z, v3(e.axis!)), false);
    case 'capsule': {
      const from = v3(e.start_m!), along = v3(e.end_m!).sub(from);
      return put(new CapsuleGeometry(e.radius_m, along.length(), 16, 32), from.addScaledVector(along, 0.5).toArray(), between(Y, along), false);
    }
    case 'plate': {
      const [x, y, z] = e.half_size_m!, outline = new Shape([[-x, -y], [x, -y], [x, y], [-x, y]].map(([a, b]) => new Vector2(a, b)));
      for (const [a, b, r] of e.holes_m!) outline.holes.push(new Path().absarc(a, b, r, 0, 2 * Math.PI, true));
      return put(new ExtrudeGeometry(outline, { depth: 2 * z, bevelEnabled: false, curveSegments: 32 }).translate(0, 0, -z), e.center_m!, quaternion(e.attitude!));
    }
  }
  if (e.profile_m) return revolved(e, material, line);
  if (!e.triangles?.length) return null;
  const triangles = new BufferGeometry().setAttribute('position', new Float32BufferAttribute(e.vertices_m!, 3)).setIndex(e.triangles);
  // It takes vertices within 0.01 for one.
  return put(toCreasedNormals(triangles.scale(1e5, 1e5, 1e5), CREASE).scale(1e-5, 1e-5, 1e-5), [0, 0, 0]);
}
/** A solid of revolution; a hole is in a round block that is cut open towards the oblique view. */
function revolved(e: Element, material: MeshLambertMaterial, line: string): Group {
  const hole = e.kind === 'hole', corners = e.profile_m!.map(([r, z]) => new Vector2(r, z));
  if (hole) {
    const deep = corners.at(-1)!.y - 0.006, wide = Math.max(0.05, 3 * corners[0]!.x);
    corners.unshift(new Vector2(0, deep), new Vector2(wide, deep), new Vector2(wide, 0));
  }
  const from = hole ? -0.45 + Math.PI / 4 : 0, over = hole ? 1.5 * Math.PI : 2 * Math.PI;
  const all = new Group(), lathe = new LatheGeometry(corners, 96, from, over);
  all.add(solid(lathe, material));
  all.add(edges(lathe, line));
  if (hole)
    for (const end of [from, from + over]) {
      const cut = solid(new ShapeGeometry(new Shape(corners)), material);
      cut.rotation.y = end - Math.PI / 2;
      all.add(cut);
    }
  all.position.copy(v3(e.point_m!));
  all.quaternion.copy(between(Y, v3(e.axis!)));
  return all;
}

interface ArmParts {
  base: Group;
  joints: { part: Group; slides: boolean; twin: Group | null }[];
  flange: Group;
}

export class Space {
  private readonly world = new Scene();
  private readonly camera = new OrthographicCamera();
  private readonly light = new DirectionalLight(0xffffff, 2.2);
  private readonly robot: MeshLambertMaterial;
  private readonly walls: { material: MeshLambertMaterial; normal: Vector3 }[] = [];
  private readonly tool = new Group();
  private readonly hand = new Group();
  private readonly fingers: Mesh[] = [];
  private object: Object3D | null = null;
  private handOld = false;
  private readonly arms: { parts: ArmParts; of: 'leader' | 'robot' }[] = [];
  private readonly leader: MeshLambertMaterial;
  private readonly floor: Mesh;
  private drawn = { at: 0, mean_ms: 0, frames: 0 };

  /** Null where the browser has no WebGL. */
  static on(canvas: HTMLCanvasElement, scene: Introduction): Space | null {
    try {
      return new Space(new WebGLRenderer({ canvas, antialias: true, alpha: true }), scene);
    } catch {
      return null;
    }
  }

  private constructor(
    private readonly renderer: WebGLRenderer,
    scene: Introduction,
  ) {
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFSoftShadowMap;
    this.world.add(new HemisphereLight(0xffffff, 0x8899aa, 1.6), this.light, this.light.target);
    this.light.castShadow = true;
    this.light.shadow.mapSize.set(1024, 1024);
    this.light.shadow.radius = 3;
    this.light.shadow.normalBias = 0.002;
    this.robot = new MeshLambertMaterial({ color: colour('--robot') });
    this.leader = new MeshLambertMaterial({ color: colour('--hand') });
    for (const element of [...scene.environment, ...scene.meshes]) this.addElement(element);
    this.floor = new Mesh(new PlaneGeometry(6, 6), new ShadowMaterial({ opacity: 0.25 }));
    this.floor.receiveShadow = true;
    if (scene.arm) this.arms.push({ parts: this.makeArm(scene, scene.arm, this.robot), of: 'robot' });
    if (scene.leader) this.arms.push({ parts: this.makeArm(scene, { ...scene.leader, links: scene.leader.links ?? scene.arm!.links }, this.leader), of: 'leader' });
    this.floor.visible = this.arms.length > 0;
    this.world.add(this.floor, this.tool, this.hand);
    this.addTool(scene);
    if (scene.object_half_size_m) {
      const material = new MeshLambertMaterial({ color: colour('--third') });
      this.object = shapeOf({ kind: 'box', center_m: [0, 0, 0], half_size_m: scene.object_half_size_m }, material, colour('--text'))!;
      this.world.add(this.object);
    }
  }
  dispose(): void {
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  // What there is.

  private addElement(e: Element): void {
    const line = colour('--surface-line'), material = new MeshLambertMaterial({ color: colour('--solid'), side: DoubleSide });
    if (e.kind === 'wall') {
      const normal = v3(e.normal!), mesh = solid(new BoxGeometry(2 * WALL_M, 2 * WALL_M, 0.004), material);
      mesh.position.copy(normal).multiplyScalar(e.offset_m! - 0.002);
      mesh.quaternion.copy(between(Z, normal));
      mesh.castShadow = false;
      mesh.add(edges(mesh.geometry, line));
      const grid: number[] = [];
      for (let u = -WALL_M + 0.02; u < WALL_M; u += 0.02) grid.push(u, -WALL_M, 0.0021, u, WALL_M, 0.0021, -WALL_M, u, 0.0021, WALL_M, u, 0.0021);
      const lines = new BufferGeometry().setAttribute('position', new Float32BufferAttribute(grid, 3));
      mesh.add(new LineSegments(lines, new LineBasicMaterial({ color: line, transparent: true, opacity: 0.25 })));
      material.transparent = true;
      this.walls.push({ material, normal });
      this.world.add(mesh);
      return;
    }
    const shape = shapeOf(e, material, line);
    if (shape) this.world.add(shape);
  }
  /** The tool's parts, the convex hull of contact points that belong to none, and a ghost of both at the hand. */
  private addTool(scene: Introduction): void {
    const points = scene.tool.map(v3), alone = scene.tool_parts.length > 0 ? points.slice(0, scene.tool_alone) : points;
    const wide = alone.length > 1 ? SKIN_M : 0.006, around: Vector3[] = [];
    for (const p of scene.tool_parts.length > 0 || alone.length > 0 ? alone : [new Vector3()])
      for (const axis of [0, 1, 2]) for (const side of [-1, 1]) around.push(p.clone().setComponent(axis, p.getComponent(axis) + side * wide));
    const hull = around.length > 0 ? new ConvexGeometry(around) : null;
    const ghost = new MeshLambertMaterial({ color: colour('--hand'), transparent: true, opacity: 0.3, depthWrite: false });
    for (const [group, material, line] of [[this.tool, this.robot, colour('--text')], [this.hand, ghost, colour('--hand')]] as const) {
      if (hull) group.add(solid(hull, material), edges(hull, line));
      for (const part of scene.tool_parts) {
        const shape = shapeOf(part, material, line);
        if (shape) group.add(shape);
      }
    }
    this.hand.traverse((o) => {
      o.castShadow = o.receiveShadow = false;
      if (o instanceof LineSegments) (o.material as LineBasicMaterial).depthTest = false; // a hand is seen within a wall too
    });
    const at = new BufferGeometry().setFromPoints(points);
    this.tool.add(new Points(at, new PointsMaterial({ color: colour('--text'), size: 4, sizeAttenuation: false })));
    const middle = points.reduce((sum, p) => sum.addScaledVector(p, 1 / points.length), new Vector3());
    if (this.arms.length === 0 && middle.length() > 0.01) this.tool.add(solid(new CapsuleGeometry(0.006, 0, 8, 24), this.robot), rod(new Vector3(), middle, 0.003, this.robot));
    if (scene.gripper_m === null) return;
    for (let i = 0; i < 2; ++i) {
      const finger = solid(new BoxGeometry(0.012, 0.006, 0.04), this.robot);
      this.fingers.push(finger);
      this.tool.add(finger);
    }
  }
  private makeArm(scene: Introduction, arm: Arm, rings: MeshLambertMaterial): ArmParts {
    const link = new MeshLambertMaterial({ color: colour('--solid'), side: DoubleSide }), none = new Vector3();
    /** The shape that the arm's file knows of the base, or of the link behind joint i; else rods are drawn. */
    const own = arm.links!.map((e) => shapeOf(e, link, colour('--surface-line')));
    const base = new Group(), joints: ArmParts['joints'] = [], all = arm.joints;
    const length = (p: Vec): number => Math.hypot(...p);
    // A tool that reaches back towards the arm covers that much of the last link.
    const flange = v3(arm.flange_m), back = Math.max(0, ...scene.tool.map((p) => Math.abs(p[2])));
    let parent = base;
    base.add(own[0] ?? rod(new Vector3(0, 0, 0), new Vector3(0, 0, 0.02), 2 * LINK_M, link));
    all.forEach((joint, i) => {
      const fixed = new Group(), moving = new Group(), origin = v3(joint.origin_m);
      if (!own[i] && length(joint.origin_m) > 1e-6) parent.add(rod(none, origin, 0.75 * LINK_M, link));
      fixed.position.copy(origin);
      fixed.quaternion.copy(quaternion(joint.attitude));
      const thick = LINK_M * (1 - 0.05 * i);
      const shape = own[i + 1];
      if (joint.mirrored) {
        const twin = new Group();
        for (const [finger, side] of [[moving, 1], [twin, -1]] as const) {
          const beside = new Vector3(0, 0, side * FINGER_M), mesh = shape?.clone() ?? rod(beside, flange.clone().add(beside), FINGER_M, rings);
          if (shape) mesh.scale.z = side;
          finger.add(mesh);
        }
        fixed.add(moving, twin);
        parent.add(fixed);
        parent = fixed; // the tool stays between the fingers
        joints.push({ part: moving, slides: true, twin });
        return;
      }
      if (shape) moving.add(shape);
      else
        moving.add(
          rod(new Vector3(0, 0, -thick), new Vector3(0, 0, thick), 1.1 * thick, link),
          rod(new Vector3(0, 0, -0.006), new Vector3(0, 0, 0.006), 1.13 * thick, rings),
        );
      fixed.add(moving);
      parent.add(fixed);
      parent = moving;
      joints.push({ part: moving, slides: joint.slides, twin: null });
    });
    const shown = flange.clone().setLength(Math.max(0.01, flange.length() - back));
    if (!own[all.length] && !all.at(-1)!.mirrored && flange.length() > 1e-6) parent.add(rod(none, shown, 0.5 * LINK_M, link));
    const end = new Group();
    end.position.copy(flange);
    parent.add(end);
    this.world.add(base);
    return { base, joints, flange: end };
  }

  // Where it is.

  /** Corners of the boxes around the arms as they were drawn last. */
  armPlaces(): Vec[] {
    return this.arms.flatMap(({ parts }) => {
      const { min, max } = new Box3().setFromObject(parts.base);
      return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z): Vec => [x, y, z])));
    });
  }
  private pose(s: Shown): void {
    this.tool.position.copy(v3(s.robot));
    this.tool.quaternion.copy(quaternion(s.robotAttitude));
    this.object?.position.copy(v3(s.object));
    this.hand.position.copy(v3(s.hand));
    this.hand.quaternion.copy(quaternion(s.handAttitude));
    this.robot.color.set(colour(s.robotOld ? '--muted' : '--robot'));
    this.leader.color.set(colour(s.old ? '--muted' : '--hand'));
    if (s.old !== this.handOld)
      this.hand.traverse((o) => (o instanceof Mesh || o instanceof LineSegments) && o.material.color.set(colour(s.old ? '--muted' : '--hand')));
    this.handOld = s.old;
    this.fingers.forEach((finger, i) => finger.position.set(0, (i === 0 ? 1 : -1) * (0.5 * (s.fingers ?? 0) + 0.003), 0.02));
    // A base stands where the tool is at its place.
    for (const { parts: { base, joints, flange }, of } of this.arms) {
      const [at, tool] = of === 'robot' ? [s.joints, s.robot] : [s.leaderJoints, s.hand];
      joints.forEach(({ part, slides, twin }, i) => {
        (slides ? part.position : part.rotation).z = at[i] ?? 0;
        if (twin) twin.position.z = -part.position.z;
      });
      base.position.set(0, 0, 0);
      const from = flange.getWorldPosition(new Vector3());
      base.position.copy(v3(tool)).sub(from);
      this.floor.position.copy(base.position);
    }
  }

  /** A browser that is slow, as without a graphics processor, draws no shadow. */
  private spare(): void {
    const { at, mean_ms, frames } = this.drawn, now = performance.now();
    this.drawn = { at: now, mean_ms: frames > 0 ? mean_ms + 0.1 * (Math.min(now - at, 200) - mean_ms) : 0, frames: frames + 1 };
    if (frames > SLOW_FRAMES && mean_ms > SLOW_MS) this.light.castShadow = false;
  }

  /** The point `centre` is at 45 % of the width and half of the height, `scale` pixels are a metre. */
  draw(s: Shown, view: View, centre: Vec, scale: number, width: number, height: number): void {
    this.pose(s);
    const c = this.camera, middle = v3(centre), out = v3(view.out);
    [c.left, c.right, c.top, c.bottom] = [(-0.45 * width) / scale, (0.55 * width) / scale, (0.5 * height) / scale, (-0.5 * height) / scale];
    [c.near, c.far] = [0.01, 2 * AHEAD_M];
    c.position.copy(middle).addScaledVector(out, AHEAD_M);
    c.up.copy(v3(view.up));
    c.lookAt(middle);
    c.updateProjectionMatrix();
    const reach = Math.min(1.5, Math.max(0.1, (0.6 * Math.max(width, height)) / scale)), shadow = this.light.shadow.camera;
    [shadow.left, shadow.right, shadow.top, shadow.bottom, shadow.near, shadow.far] = [-reach, reach, reach, -reach, 0.1, 6];
    shadow.updateProjectionMatrix();
    this.light.target.position.copy(middle);
    this.light.position.copy(middle).add(new Vector3(-1.1, -1.0, 2.2));
    // From behind one sees through a wall.
    for (const wall of this.walls) wall.material.opacity = wall.normal.dot(out) < -0.02 ? 0.25 : 1;
    const ratio = window.devicePixelRatio || 1, size = this.renderer.getSize(new Vector2());
    if (size.x !== width || size.y !== height || this.renderer.getPixelRatio() !== ratio) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
    }
    this.renderer.render(this.world, this.camera);
    this.spare();
  }
}
