"""The list of clips as it fills: each conversion gets its rows, its name and its entry."""

from pathlib import Path

from poseloom.library.catalogue import CATALOGUE_FILE, Clip, SkipKind, Skipped, read_catalogue
from poseloom.library.conversion import Conversion, NewClip
from poseloom.library.poses import POSES_FILE, PoseWriter, open_poses
from poseloom.library.sources import Source

_MIRROR_MARK = "~mirror"


class Filling:
    """What a generation holds so far.

    Attributes:
        clips: Clips in the order of their rows.
        skipped: What was not taken.
    """

    def __init__(self) -> None:
        self.clips: list[Clip] = []
        self.skipped: list[Skipped] = []
        self._names: set[str] = set()
        self._sources: dict[str, str] = {}

    def take_over(self, generation: Path, writer: PoseWriter) -> None:
        """Starts with all that an earlier generation holds."""
        clips, skipped = read_catalogue(generation / CATALOGUE_FILE)
        writer.write(open_poses(generation / POSES_FILE).values)
        self.clips += clips
        self.skipped += skipped
        self._names |= {clip.name for clip in clips}
        self._sources |= {clip.digest: clip.source for clip in clips}

    def add(self, source: Source, conversion: Conversion, writer: PoseWriter) -> None:
        """Takes in what came of a source, unless the same bytes are held already."""
        held = self._sources.get(conversion.digest)
        if held is not None:
            self.skipped.append(Skipped(source.name, SkipKind.KNOWN, f"the same bytes as {held}"))
            return
        self.skipped += conversion.skipped
        if conversion.clips:
            self._sources[conversion.digest] = source.name
        name = ""
        for clip in conversion.clips:
            if not clip.mirrored:  # a mirror image follows what it mirrors and shares its name
                name = self._unused(_stem(source) + (f":{clip.name}" if clip.name else ""))
            start = writer.rows
            writer.write(clip.poses)
            self.clips.append(_entry(len(self.clips), name, source, conversion, clip, start))

    def _unused(self, name: str) -> str:
        candidate, number = name, 1
        while candidate in self._names:
            number += 1
            candidate = f"{name}#{number}"
        self._names.add(candidate)
        return candidate


def _stem(source: Source) -> str:
    return source.name if source.path is None else source.name.removesuffix(source.path.suffix)


def _entry(number: int, name: str, source: Source, conversion: Conversion, clip: NewClip, start: int) -> Clip:
    return Clip(
        id=number,
        name=name + _MIRROR_MARK * clip.mirrored,
        take=name,
        subject=source.subject,
        source=source.name,
        digest=conversion.digest,
        start=start,
        stop=start + len(clip.poses),
        mirrored=clip.mirrored,
        source_rate=clip.source_rate,
        family=clip.family,
        licence=source.licence,
        tags=source.tags,
        conventions=clip.conventions,
    )
