"""A control law in a separate program: PD with weight compensation.

Run python controller.py 9000, and then in another shell flexlab --law tcp://localhost:9000
"""

import socket
import sys

import msgspec

POSITION_GAIN, VELOCITY_GAIN = 2e4, 800.0  # N/m and N·s/m along x and y, N·m/rad and N·m·s/rad about θ


def receive(connection):
    """Return the next message, or None at the end: four bytes of length, highest first, then as many of MessagePack."""
    head = connection.recv(4, socket.MSG_WAITALL)
    if len(head) < 4:
        return None
    return msgspec.msgpack.decode(connection.recv(int.from_bytes(head, "big"), socket.MSG_WAITALL))


def send(connection, message):
    data = msgspec.msgpack.encode(message)
    connection.sendall(len(data).to_bytes(4, "big") + data)


def act(at):
    """Return the inputs of the arms: forces, N, and torques, N·m, at the grips, (arms, 3)."""
    errors = [
        -POSITION_GAIN * (x - x_d) - VELOCITY_GAIN * (v - v_d)
        for x, x_d, v, v_d in zip(at["pose"], at["desired_pose"], at["pose_rate"], at["desired_rate"], strict=True)
    ]
    return [
        [weight + share * error for weight, error in zip(weights, errors, strict=True)]
        for weights, share in zip(at["weights"], at["share"], strict=True)
    ]


with socket.create_server(("localhost", int(sys.argv[1]))) as server:
    print(f"listening: flexlab --law tcp://localhost:{server.getsockname()[1]}", flush=True)
    while True:
        connection, _ = server.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            print("asked for", ", ".join(receive(connection)["asks"]), flush=True)
            send(connection, {"version": 1})
            while (at := receive(connection)) is not None:
                send(connection, {"inputs": act(at)})
