"""The names of each class in the paper's spelling, for type checkers: see paper_names.pyi beside this file.

`both_spellings` adds them to the classes themselves when yasps runs, so that there is nothing here.
"""


class AttributeNames: ...


class ConnectivityNames: ...


class EntityNames: ...


class PrimitiveBaseNames: ...


class PrimitiveNames: ...


class PrimitiveUnionNames: ...


class MeshNames: ...


class SceneNames: ...
