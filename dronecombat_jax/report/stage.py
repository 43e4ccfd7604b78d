"""The stage of a fight: an off-screen OpenGL context, cameras and the marks that make 9 cm visible.

A drone is a few pixels in a 10 m arena, so the arena view hides the true drones and shows them
enlarged, with trails, plumb lines to the floor and the radii of the rules. What does not live
here: text (`caption`), frames and files (`video`), which OpenGL draws (`rendering`).
"""

import copy
from typing import Any

import mujoco
import numpy as np

from dronecombat_jax.machine import rendering
from dronecombat_jax.sim.scene import Scene

ENLARGEMENT = 4.0  # of the drones in the arena view
TEAM_COLOURS = ((0.12, 0.47, 0.95), (0.96, 0.42, 0.08))  # defender, attacker: those of combat.xml
TARGET_COLOUR = (0.16, 0.80, 0.42)
_BUBBLES, _DRONES = 1, 2  # visual groups of combat.xml


class Stage:
    """Renders states of one scene; use as a context manager, since it holds an OpenGL context.

    Raises UserError where nothing can be drawn here (`rendering`).
    """

    def __init__(self, scene: Scene, width: int, height: int):
        self.scene = scene
        # the camera of the copy moves back, its buffer fits the picture
        self.model = copy.copy(scene.full)
        self.model.vis.global_.offwidth, self.model.vis.global_.offheight = width, height
        self.model.vis.quality.offsamples = 4
        self.model.vis.quality.shadowsize = 1024
        self.data = mujoco.MjData(self.model)
        self.context = rendering.open_context(width, height)
        try:
            self.renderer = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        except mujoco.FatalError as error:  # a context that lacks what MuJoCo draws with
            self.context.free()
            raise rendering.cannot_draw(error) from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self.renderer)
        self.visuals = mujoco.MjvScene(self.model, 10_000)
        self.visuals.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self.options = mujoco.MjvOption()

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *_: object) -> None:
        self.renderer.free()
        self.context.free()

    def set_state(self, qpos: np.ndarray, target: np.ndarray) -> None:
        """Put all drones (`qpos` [7 A]) and the target [3] in place."""
        self.data.qpos[:] = qpos
        self.data.mocap_pos[self.scene.target_mocap] = target
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def fit_arena_camera(self, points: np.ndarray, aspect: float) -> None:
        """Move the arena camera straight back until `points` [K, 3] are in the picture, clear of
        its captions.
        """
        camera = self.scene.arena_camera
        for _ in range(60):
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_camlight(self.model, self.data)
            across, up = self.project(points, aspect).T
            if np.abs(across).max() < 0.95 and up.max() < 0.72 and up.min() > -0.85:
                return
            backwards = self.data.cam_xmat[camera].reshape(3, 3)[:, 2]
            self.model.cam_pos[camera] += 0.5 * backwards

    def project(self, points: np.ndarray, aspect: float) -> np.ndarray:
        """World points [K, 3] to the arena picture [K, 2]: x to the right, y up, each in [-1, 1]."""
        camera = self.scene.arena_camera
        local = (np.atleast_2d(points) - self.data.cam_xpos[camera]) @ self.data.cam_xmat[
            camera
        ].reshape(3, 3)
        half = np.tan(np.radians(self.model.cam_fovy[camera]) / 2.0)
        depth = np.maximum(-local[:, 2], 1e-3)
        return local[:, :2] / depth[:, None] / (half * np.array([aspect, 1.0]))

    def show_arena(self) -> None:
        """Start a picture from the arena camera, without true-size drones: see `add_drone`."""
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.scene.arena_camera
        self._update(camera, true_drones=False)

    def show_chase(self, drone: int, towards: np.ndarray, distance: float = 0.55) -> None:
        """Start a picture from behind a true-size drone, looking over it at the point `towards`
        [3].
        """
        position = self.data.xpos[self.scene.bodies[drone]]
        heading = np.asarray(towards) - position
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat = position + np.array([0.0, 0.0, 0.06])
        camera.azimuth = np.degrees(np.arctan2(heading[1], heading[0]))
        slope = np.degrees(np.arctan2(heading[2], np.hypot(heading[0], heading[1])))
        camera.elevation = np.clip(slope - 14.0, -60.0, 10.0)
        camera.distance = distance
        self._update(camera, true_drones=True)

    def pixels(self, width: int, height: int) -> np.ndarray:
        """Render what was shown and added: uint8 [height, width, 3]."""
        rect = mujoco.MjrRect(0, 0, width, height)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_render(rect, self.visuals, self.renderer)
        mujoco.mjr_readPixels(image, None, rect, self.renderer)
        return image[::-1]

    def add_drone(
        self, drone: int, qpos: np.ndarray, alpha: float = 1.0, scale: float = ENLARGEMENT
    ) -> None:
        """Add an enlarged drone at the pose `qpos` [7]; true poses of the model are not used."""
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, np.asarray(qpos[3:7], float))
        turn, model = rotation.reshape(3, 3), self.model
        for geom in np.flatnonzero(model.geom_bodyid == self.scene.bodies[drone]):
            local = np.empty(9)
            mujoco.mju_quat2Mat(local, model.geom_quat[geom])
            added = self._add(
                model.geom_type[geom],
                model.geom_size[geom] * scale,
                qpos[:3] + turn @ (model.geom_pos[geom] * scale),
                (turn @ local.reshape(3, 3)).ravel(),
                model.mat_rgba[model.geom_matid[geom]] * (1.0, 1.0, 1.0, alpha),
            )
            added.emission = model.mat_emission[model.geom_matid[geom]]
            added.category = int(mujoco.mjtCatBit.mjCAT_DYNAMIC) if alpha == 1.0 else added.category

    def add_bubble(
        self, centre: np.ndarray, radius: float, colour: tuple[float, ...], alpha: float
    ) -> None:
        """Add a translucent sphere."""
        self._add(
            mujoco.mjtGeom.mjGEOM_SPHERE, [radius] * 3, centre, np.eye(3).ravel(), (*colour, alpha)
        )

    def add_trail(
        self, points: np.ndarray, colour: tuple[float, ...], radius: float = 0.022
    ) -> None:
        """Add a tube through `points` [K, 3] that fades towards its start."""
        if len(points) > 160:
            points = points[np.unique(np.linspace(0, len(points) - 1, 160).astype(int))]
        for index in range(len(points) - 1):
            alpha = 0.25 + 0.75 * (index + 1) / len(points)
            self.add_segment(points[index], points[index + 1], radius, (*colour, alpha))

    def add_plumb_line(self, point: np.ndarray, colour: tuple[float, ...], alpha: float) -> None:
        """Add a thin line from `point` down to the floor, and a dot there."""
        foot = np.array([point[0], point[1], 0.004])
        self.add_segment(np.asarray(point, float), foot, 0.006, (*colour, alpha))
        self._add(
            mujoco.mjtGeom.mjGEOM_CYLINDER,
            [0.05, 0.05, 0.002],
            foot,
            np.eye(3).ravel(),
            (*colour, alpha),
        )

    def add_segment(
        self, start: np.ndarray, end: np.ndarray, radius: float, rgba: tuple[float, ...]
    ) -> None:
        """Add a capsule from `start` to `end`."""
        geom = self._add(mujoco.mjtGeom.mjGEOM_CAPSULE, np.ones(3), start, np.eye(3).ravel(), rgba)
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, start, end)

    def _update(self, camera: Any, true_drones: bool) -> None:
        self.options.geomgroup[_DRONES] = int(true_drones)
        # a third of the time, barely seen
        self.visuals.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(not true_drones)
        # drawn here with the radii of the rules in force, without shadow
        self.options.sitegroup[_BUBBLES] = 0
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self.options,
            None,
            camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self.visuals,
        )

    def _add(self, kind: Any, size: Any, position: Any, rotation: Any, rgba: Any) -> Any:
        if self.visuals.ngeom >= self.visuals.maxgeom:
            raise RuntimeError("more marks than the scene has room for")
        geom = self.visuals.geoms[self.visuals.ngeom]
        mujoco.mjv_initGeom(
            geom,
            int(kind),
            np.asarray(size, float),
            np.asarray(position, float),
            np.asarray(rotation, float),
            np.asarray(rgba, np.float32),
        )
        geom.category = int(mujoco.mjtCatBit.mjCAT_DECOR)  # a mark casts no shadow
        geom.transparent = int(rgba[3] < 1.0)
        geom.emission = 0.45
        self.visuals.ngeom += 1
        return geom
