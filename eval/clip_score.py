"""CLIP score: does each frame look like what the text asks for? Radford et al. 2021; as a score Hessel et al. 2021."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from numpy.typing import NDArray

from eval.cosine import cosines
from eval.errors import MetricError
from eval.score import Score
from eval.values import mean

Resize = Literal["shortest", "squash", "longest"]


@dataclass(frozen=True, kw_only=True)
class ClipScore:
    """What is compared with what. Each choice moves the number, as does the model.

    Parameters
    ----------
    prompt
        The text: "base", what the scene shows; "instruction", what the edit shall do; "joined", the one, then the
        other. A joined text is longer than CLIP reads: of 130 tokens it reads 77, and what is cut is the instruction.
    resize
        How a frame becomes CLIP's square: "shortest", its middle (55 % of one of 1280x704 is seen), "squash", all of
        it with its sides squashed, "longest", all of it between black bars.
    """

    prompt: Literal["base", "instruction", "joined"] = "instruction"
    resize: Resize = "shortest"

    def text(self, *, base: str | None = None, instruction: str | None = None) -> str:
        """The text that frames are compared with.

        >>> ClipScore(prompt="joined").text(base="A street.", instruction="Dense fog.")
        'A street. Dense fog.'

        Raises
        ------
        MetricError
            A part that is needed is not given, or is empty.
        """
        parts = {"base": base, "instruction": instruction}
        needed = list(parts) if self.prompt == "joined" else [self.prompt]
        texts = [(parts[name] or "").strip() for name in needed]
        missing = [name for name, text in zip(needed, texts, strict=True) if not text]
        if missing:
            raise MetricError(f"prompt mode {self.prompt!r}: expected a text for {' and '.join(missing)}, got none")
        return " ".join(texts)


PRESETS = {"instruction": ClipScore(), "paper": ClipScore(prompt="joined")}


def clip_score(images: NDArray[Any], text: NDArray[Any], *, tokens: int, context: int = 77) -> Score:
    """Mean over frames of the cosine of a frame's embedding and the text's: raw, on the scale where 0.25 is usual.

    (Hessel's score is 2.5 times that and not below 0, torchmetrics' 100 times.)

    Parameters
    ----------
    images, text
        Embeddings of T frames (T, E) and of the text (E,), of any length.
    tokens, context
        How many tokens the text has, with its start and end, and how many the model reads. What was cut is counted
        in `others`.

    >>> import numpy as np
    >>> found = clip_score(np.array([[1.0, 0.0], [3.0, 4.0]]), np.array([2.0, 0.0]), tokens=130)
    >>> found.value, found.others["tokens cut"]
    (0.8, 53.0)

    Raises
    ------
    MetricError
        Embeddings of two lengths, or not finite.
    """
    frames = cosines(images, text)
    counts = {"tokens": float(tokens), "tokens cut": float(max(0, tokens - context))}
    return Score(value=mean(frames), frames=frames, others=counts)


def cut(tokens: int, context: int) -> str | None:
    """What to tell whoever gave a text that is longer than the model reads; None if it is not.

    >>> cut(79, 77)
    'the text has 79 tokens, and the model reads 77: its last 2 are not scored'
    >>> cut(77, 77)
    """
    if tokens <= context:
        return None
    return f"the text has {tokens} tokens, and the model reads {context}: its last {tokens - context} are not scored"
