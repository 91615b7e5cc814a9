"""Arms in Pinocchio: mass matrix, Coriolis matrix, weight and grip Jacobian in relative joint angles."""

import numpy as np
import pinocchio as pin

from flexlab.scenario import Arm

PLANE = [0, 1, 5]
"""Indices of vx, vy, ωz in a six-dimensional velocity."""


class PinocchioArm:
    """One arm that holds the payload at s = side · L/2; `side` -1 or 1."""

    def __init__(self, arm: Arm, side: int, payload_length: float, gravity: float):
        self.arm, self.side, self.payload_length = arm, side, payload_length
        self.model = pin.Model()
        self.model.gravity = pin.Motion(np.array([0, -gravity, 0, 0, 0, 0], float))
        joint, place = 0, pin.SE3(np.eye(3), np.array([*arm.base, 0.0]))
        links = zip(arm.link_mass, arm.link_length, arm.link_center, arm.inertia, strict=True)
        for mass, length, center, inertia in links:
            joint = self.model.addJoint(joint, pin.JointModelRZ(), place, f"joint{joint}")
            # Only the inertia about z matters in a plane.
            body = pin.Inertia(mass, np.array([center, 0.0, 0.0]), np.diag([inertia, inertia, inertia]))
            self.model.appendBodyToJoint(joint, body, pin.SE3.Identity())
            place = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        self.grip = self.model.addFrame(pin.Frame("grip", joint, place, pin.FrameType.OP_FRAME))
        self.data = self.model.createData()

    def angles(self, pose: np.ndarray) -> np.ndarray:
        """Relative joint angles (3,) at a pose (3,), from the triangle base-elbow-wrist with the scenario's elbow side."""
        l1, l2, l3 = self.arm.link_length
        last = pose[2] + (np.pi if self.side > 0 else 0.0)
        grip = pose[:2] + self.side * self.payload_length / 2 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        wrist = grip - l3 * np.array([np.cos(last), np.sin(last)]) - self.arm.base
        bend = self.arm.elbow * np.arccos((wrist @ wrist - l1**2 - l2**2) / (2 * l1 * l2))
        first = np.arctan2(wrist[1], wrist[0]) - np.arctan2(l2 * np.sin(bend), l1 + l2 * np.cos(bend))
        return np.array([first, bend, last - first - bend])

    def in_task_space(self, pose: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, ...]:
        """M̄ (3, 3), C̄ (3, 3) and Ḡ (3,) by Eqs. (12), (13)."""
        angles, rotation = self.angles(pose), np.array([-np.sin(pose[2]), np.cos(pose[2])])
        arm_at = self.side * self.payload_length / 2
        J_x, J_x_rate = np.eye(3), np.zeros((3, 3))
        J_x[:2, 2] = arm_at * rotation
        J_x_rate[:2, 2] = -arm_at * rate[2] * np.array([np.cos(pose[2]), np.sin(pose[2])])
        frame = pin.LOCAL_WORLD_ALIGNED
        J_theta = pin.computeFrameJacobian(self.model, self.data, angles, self.grip, frame)[PLANE].copy()
        J = np.linalg.solve(J_theta, J_x)
        speeds = J @ rate
        pin.computeJointJacobiansTimeVariation(self.model, self.data, angles, speeds)
        pin.updateFramePlacements(self.model, self.data)
        J_theta_rate = pin.getFrameJacobianTimeVariation(self.model, self.data, self.grip, frame)[PLANE].copy()
        J_rate = np.linalg.solve(J_theta, J_x_rate - J_theta_rate @ J)
        M = pin.crba(self.model, self.data, angles).copy()
        M = np.triu(M) + np.triu(M, 1).T
        C = pin.computeCoriolisMatrix(self.model, self.data, angles, speeds).copy()
        G = pin.computeGeneralizedGravity(self.model, self.data, angles).copy()
        return J.T @ M @ J, J.T @ (C @ J + M @ J_rate), J.T @ G


def pinocchio_arms(scenario) -> list[PinocchioArm]:
    """All arms of a scenario."""
    sides = (-1, 1)
    return [
        PinocchioArm(arm, side, scenario.payload.length, scenario.gravity)
        for arm, side in zip(scenario.arms, sides, strict=False)
    ]
