"""Turret in Exudyn with prescribed slewing and luffing angles: its kinematics are Exudyn's."""

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree, SensorKinematicTree

from pmr.files.arrays import Array
from pmr.scene.signals import SignalBase

#: From the boom's axes, x along it and z up, to those of its link, which turns about its z.
HINGE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
MEASURED = ("RotationMatrix", "AngularVelocity", "AngularAcceleration")


class Turret:
    """Kinematics of a boom: link 0 turns about the vertical, link 1 about the boom's -y and carries the boom.

    The boom lies along the x axis of link 1.  At the times t (T,) in s: `rotation` (T, 3, 3) from the boom's axes to
    space, and in the boom's axes the angular `velocity` (T, 3) in rad/s and `acceleration` (T, 3) in rad/s^2.
    """

    def __init__(self, luffing: SignalBase, slewing: SignalBase, t: Array) -> None:
        container = exu.SystemContainer()  # owns the mbs: must stay alive
        mbs = container.AddSystem()
        zero = dict.fromkeys(("referenceCoordinates", "initialCoordinates", "initialCoordinates_t"), [0.0, 0.0])
        tree = mbs.AddObject(
            ObjectKinematicTree(
                nodeNumber=mbs.AddNode(NodeGenericODE2(numberOfODE2Coordinates=2, **zero)),
                jointTypes=[exu.JointType.RevoluteZ, exu.JointType.RevoluteZ],
                linkParents=[-1, 0],
                jointTransformations=exu.Matrix3DList([np.eye(3), HINGE.T]),
                jointOffsets=exu.Vector3DList([np.zeros(3), np.zeros(3)]),
                linkInertiasCOM=exu.Matrix3DList([np.eye(3), np.eye(3)]),
                linkCOMs=exu.Vector3DList([np.zeros(3), np.zeros(3)]),
                linkMasses=[1.0, 1.0],
            )
        )
        boom = {"objectNumber": tree, "linkNumber": 1, "localPosition": [0.0, 0.0, 0.0]}
        kinds = [getattr(exu.OutputVariableType, name) for name in MEASURED]
        sensors = [mbs.AddSensor(SensorKinematicTree(**boom, outputVariableType=kind)) for kind in kinds]
        mbs.Assemble()
        rates = ("value", "rate", "second_rate")
        q, v, a = (np.column_stack([getattr(angle, one)(t) for angle in (slewing, luffing)]) for one in rates)
        measured = []
        for k in range(len(t)):
            mbs.systemData.SetODE2Coordinates(q[k])
            mbs.systemData.SetODE2Coordinates_t(v[k])
            mbs.systemData.SetODE2Coordinates_tt(a[k])
            measured.append([np.array(mbs.GetSensorValues(sensor)) for sensor in sensors])
        rotation, velocity, acceleration = (np.array(one) for one in zip(*measured, strict=True))
        self.rotation = rotation.reshape(-1, 3, 3) @ HINGE
        self.velocity = np.einsum("tji,tj->ti", self.rotation, velocity)
        self.acceleration = np.einsum("tji,tj->ti", self.rotation, acceleration)
