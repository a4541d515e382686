"""Run by the Python of an environment that has LeRobot: what its own reader finds in a dataset, as JSON."""

import json
import sys

import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.utils import dataset_to_policy_features


def numbers(item):
    """A frame without its image, of which only the mean of each colour is told."""
    shown = {name: value for name, value in item.items() if name != "observation.images.camera"}
    told = {name: value.tolist() if isinstance(value, torch.Tensor) else value for name, value in shown.items()}
    image = item.get("observation.images.camera")
    return told | ({} if image is None else {"shape": list(image.shape), "colour": image.mean((1, 2)).tolist()})


def main(root, decoder):
    data = LeRobotDataset("foretouch/test", root=root, video_backend=decoder)
    frames = sorted({0, 1, len(data) // 2, len(data) - 1})
    batch = next(iter(torch.utils.data.DataLoader(data, batch_size=4)))
    soon = LeRobotDataset("foretouch/test", root=root, episodes=[data.num_episodes - 1], video_backend=decoder,
                          delta_timestamps={"action": [0.0, 1.0 / data.fps]})  # fmt: skip
    told = {
        "length": len(data),
        "episodes": data.num_episodes,
        "fps": data.fps,
        "inputs": sorted(dataset_to_policy_features(data.features)),
        "frames": {str(frame): numbers(data[frame]) for frame in frames},
        "batch": {name: list(value.shape) for name, value in batch.items() if isinstance(value, torch.Tensor)},
        "two_actions": soon[0]["action"].tolist(),
        "mean": {name: one["mean"].tolist() for name, one in data.meta.stats.items()},
    }
    sys.stdout.write("\n" + json.dumps(told) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
