"""A user's path in a process of its own: reads what it is asked for from a socket, answers, says what goes wrong.

python -m flexlab.own_paths.child CALLS REPORTS FILE      (see `own_laws.child`)

A question: two whole numbers (int64), of options and of shares, then both as float64. An answer: one whole number, of poses,
then how long the path lasts and the poses, (1 + 3 poses) of float64. A problem is a report, and a whole number of -1.
"""

import socket

import numpy as np

from flexlab.own_laws.child import Reports, receive, serve
from flexlab.own_laws.running_text import TextProblem
from flexlab.own_paths.execution import RunningPath

FAILED = -1


def _answer(path: RunningPath, calls: socket.socket, reports: Reports) -> None:
    while (head := receive(calls, 16)) is not None:
        options, shares = np.frombuffer(head, np.int64).tolist()
        data = receive(calls, 8 * (options + shares))
        if data is None:
            return
        numbers = np.frombuffer(data, float)
        try:
            span, poses = path.poses(numbers[:options], numbers[options:])
        except TextProblem as problem:
            reports.say(problem=str(problem))
            calls.sendall(np.int64(FAILED).tobytes())
            continue
        calls.sendall(np.int64(len(poses)).tobytes() + np.append(span, poses.ravel()).tobytes())


if __name__ == "__main__":
    serve(RunningPath, _answer)
