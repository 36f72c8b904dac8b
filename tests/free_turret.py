"""Small boom on a rigid body in Exudyn, with momentum and energy of both."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import exudyn as exu
import free_boom
import momenta
import numpy as np
from exudyn.utilities import InertiaCuboid, NodeGenericODE2, ObjectGenericODE2, SensorNode

from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.simulation import Excitation, InitialState
from pmr.simulation.exudyn import NodeCoordinate, OnBody, add_system
from pmr.simulation.exudyn.contacts import Contacts
from pmr.simulation.exudyn.free_base import Base
from pmr.simulation.free_base import FrameMotion

PLACE = (0.1, -0.2, 0.3)
TURRET = InertiaCuboid(500.0, [1.0, 1.2, 0.8]).Translated([0.1, 0.2, 0.3])
KINDS = {"EP": exu.NodeType.RotationEulerParameters, "xyz": exu.NodeType.RotationRxyz}


class Turret:
    """Boom on a rigid body in Exudyn, whose motion, momentum and energy can be read after `solve`."""

    def __init__(self, scene: Scene, kind: str = "EP", changes: tuple[str, ...] = (), **body: Any) -> None:
        self._container, self.scene, self.system = exu.SystemContainer(), scene, free_boom.system(*changes)
        self.mbs, self.excitation = self._container.AddSystem(), Excitation.from_scene(scene)
        self.renderer = self._container.renderer
        self.body = self.mbs.CreateRigidBody(inertia=TURRET, nodeType=KINDS[kind], **body)
        self.on = OnBody(self.body, scene, PLACE)
        self.rod, self.spring, self.rods = 0.0, 0.0, list[Any]()

    def hold(self) -> None:
        """Fix the body to the ground."""
        ground = self.mbs.CreateGround()
        self.mbs.CreateGenericJoint(itemNumbers=[ground, self.body], position=[0.0, 0.0, 0.0])

    def draw(self, rod: float, s: float, rate: float, spring: float = 0.0) -> None:
        """Let a rod of `rod` kg draw the fly out, from s m and `rate` m/s, on a spring in N/m relaxed at 0.55 m."""
        start = {"referenceCoordinates": [0.55], "initialCoordinates": [s - 0.55], "initialCoordinates_t": [rate]}
        node = self.mbs.AddNode(NodeGenericODE2(numberOfODE2Coordinates=1, **start))
        moved = {"massMatrix": np.array([[rod]]), "stiffnessMatrix": np.array([[spring]])}
        self.mbs.AddObject(ObjectGenericODE2(nodeNumbers=[node], **moved))
        self.rod, self.spring, self.rods = rod, spring, [node]
        self.excitation = replace(self.excitation, paths={"fly": NodeCoordinate(node)})

    def add(self, start: Mapping[str, InitialState] | None = None) -> Any:
        """Add the boom to the system, from initial states by body, and return its items."""
        loads = {name: load for name, load in self.excitation.loads.items() if INERTIA not in name}
        self.items = add_system(self.mbs, self.system, self.excitation.paths, loads, start, on=self.on)
        return self.items

    def solve(self, tolerance: float = 1e-10) -> None:
        """Simulate; store coordinates x of the turret, q of the boom, z of the rod and their rates, (T, n) each.

        Accelerations x_tt are stored of the turret only.
        """
        own, nodes = self.mbs.GetObject(self.body)["nodeNumber"], list(self.items.nBodies.values())
        of = exu.OutputVariableType
        kinds = [of.Coordinates, of.Coordinates_t, of.Coordinates_tt]
        asked = [(own, one) for one in kinds] + [(node, one) for one in kinds[:2] for node in nodes]
        asked += [(node, one) for one in kinds[:2] for node in self.rods]
        sensors = [
            self.mbs.AddSensor(SensorNode(nodeNumber=node, outputVariableType=one, storeInternal=True))
            for node, one in asked
        ]
        self.mbs.Assemble()
        settings, stepping = exu.SimulationSettings(), self.excitation.stepping
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = stepping.step
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps = stepping.end, stepping.steps
        integration.verboseMode = 0
        integration.generalizedAlpha.spectralRadius = 1.0
        integration.newton.useModifiedNewton = False
        integration.newton.relativeTolerance = tolerance
        self.mbs.SolveDynamic(settings)
        self.t = self.excitation.times
        found = [self.mbs.GetSensorStoredData(sensor)[:, 1:] for sensor in sensors]
        self.x, self.x_t, self.x_tt = found[:3]
        n = len(nodes)
        self.q, self.q_t = np.hstack(found[3 : 3 + n]), np.hstack(found[3 + n : 3 + 2 * n])
        none = np.zeros((len(self.t), 0))
        self.z, self.z_t = found[3 + 2 * n :] if self.rods else (none, none)

    def base(self) -> Base:
        """Equations of the boom on its base, as Exudyn's items evaluate them."""
        return Base(self.mbs, self.items.parts.equations, self.items.parts.inputs, self.excitation.paths, self.on)

    def momenta(self) -> Array:
        """Linear and angular momentum (T, 6) of turret and boom about the origin of the ground, along its axes."""
        base, found = self.base(), []
        for k, t in enumerate(self.t):
            turned, _, omega, R = base.kinematics(self.x[k], self.x_t[k])
            out = base.paths.extensions(t, self.z[k], self.z_t[k])
            O = self.x[k, :3] + base.reference[:3]
            velocity, com, J = R.T @ self.x_t[k, :3], TURRET.com, TURRET.inertiaTensor
            linear = TURRET.mass * (velocity + np.cross(omega, com))
            angular = TURRET.mass * np.cross(com, velocity) + J @ omega
            own = momenta.momentum(
                base.boom,
                FrameMotion(omega, np.zeros(3)),
                turned[:3] @ self.x_t[k],
                out,
                self.q[k],
                self.q_t[k],
                base.boom.moments_with_contacts(base.answering, out),
            )
            P, L = R @ (linear + own[:3]), R @ (angular + own[3:] + np.cross(PLACE, own[:3]))
            found.append(np.append(P, L + np.cross(O, P)))
        return np.array(found)

    def energies(self) -> Array:
        """Kinetic and strain energy (T,) in J of turret, boom, rod and its spring."""
        base, found, equations = self.base(), [], self.items.parts.equations
        contacts = Contacts(equations, self.items.parts.inputs)
        for k, t in enumerate(self.t):
            turned, _, omega, R = base.kinematics(self.x[k], self.x_t[k])
            velocity, q, rate = R.T @ self.x_t[k, :3], self.q[k], self.q_t[k]
            out = base.paths.extensions(t, self.z[k], self.z_t[k])
            places = equations.side_positions_on(dict(zip(base.paths.names, out.value, strict=True)))
            K = contacts.springs(places)[0][:, : equations.size]
            own = momenta.kinetic(
                base.boom,
                FrameMotion(omega, np.zeros(3)),
                turned[:3] @ self.x_t[k],
                out,
                q,
                rate,
                base.boom.moments_with_contacts(base.answering, out),
            )
            turret = TURRET.mass * velocity @ (velocity / 2.0 + np.cross(omega, TURRET.com))
            turret += omega @ TURRET.inertiaTensor @ omega / 2.0
            rod = (self.rod * self.z_t[k] ** 2 + self.spring * self.z[k] ** 2).sum() / 2.0
            found.append(rod + own + turret + (rate @ equations.M @ rate + q @ K @ q) / 2.0)
        return np.array(found)
