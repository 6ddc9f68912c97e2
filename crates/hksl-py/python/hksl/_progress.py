"""Progress of a run: a bar in a terminal or a notebook, else a line for each evaluation."""

from __future__ import annotations

import sys
import warnings
from typing import Any, Optional


class Progress:
    """Shows a run's events on standard error."""

    def __init__(self) -> None:
        self._bar: Any = None

    def __call__(self, event: str, figures: dict[str, Any]) -> None:
        if event == "started":
            self._start(figures)
        elif event == "stepped" and self._bar is not None:
            self._move(figures)
        elif event == "evaluation_episode" and self._bar is not None:
            self._bar.set_postfix_str(f"evaluating: episode {figures['done']} of {figures['of']}")
        elif event == "pretrained" and self._bar is not None:
            self._bar.set_postfix_str(f"pretraining: step {figures['done']} of {figures['of']}")
        elif event == "evaluated":
            self._say(
                f"environment step {figures['environment_step']:>9,}  return {figures['episode_return']:>8.1f} ± "
                f"{figures['episode_return_std']:<6.1f} over {figures['episodes']} episodes"
            )
        elif event == "new_episode":
            self._say("resumed with a new episode: the environment cannot restore the interrupted one")
        elif event == "skipped_checkpoint":
            self._say(f"warning: {figures['error']}; the damaged state was moved to {figures['moved_to']}")
        elif event in ("stopped", "finished"):
            self.close()
            self._say(_ended(figures))

    def close(self) -> None:
        """Takes the bar away."""
        if self._bar is not None:
            bar, self._bar = self._bar, None
            bar.close()

    def _start(self, figures: dict[str, Any]) -> None:
        self._say(f"{figures['method']} on {figures['task']}: {figures['folder']}")
        if not _is_watched():
            return
        with warnings.catch_warnings():
            # Without widgets, notebooks have the bar as text.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm  # type: ignore[import-untyped]

        self._bar = tqdm(
            total=figures["environment_steps"],
            initial=figures["resumed_at"] or 0,
            unit=" steps",
            dynamic_ncols=True,
            leave=False,
        )

    def _move(self, figures: dict[str, Any]) -> None:
        self._bar.update(figures["environment_step"] - self._bar.n)
        if figures["last_return"] is not None:
            self._bar.set_postfix_str(f"last return {figures['last_return']:.1f}", refresh=False)

    def _say(self, text: str) -> None:
        if self._bar is not None:
            self._bar.write(text, file=sys.stderr)
        else:
            print(text, file=sys.stderr, flush=True)


def _ended(figures: dict[str, Any]) -> str:
    step = f"{figures['environment_step']:,} environment steps"
    if figures["ending"] == "stopped":
        return f"stopped and saved after {step}; repeat the call to resume"
    how = "already done" if figures["ending"] == "done before" else "done"
    return f"{how}: the last policy's mean return is {figures['final_return']:.1f} after {step}"


def _is_watched() -> bool:
    """Whether somebody looks at a bar: in a terminal or a notebook."""
    ipython: Optional[Any] = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return sys.stderr.isatty() or type(shell).__name__ == "ZMQInteractiveShell"
