"""Several laws and estimators on one recording, as a table and a picture. Writes compared.png.

python examples/compare_laws.py docs/examples/spring.csv
"""

import sys

import foretouch

if __name__ == "__main__":  # the work is done by several processes
    found = foretouch.compare(
        [foretouch.file_case(path) for path in sys.argv[1:]],
        models=["kelvin-voigt", "hunt-crossley", "contact-map"],
        estimators=["rls", "exact", "log-rls", "bank"],
    )
    table = found.to_pandas()
    columns = ["model", "estimator", "residual_percent", "prediction_error_percent", "delayed_force_error_percent"]
    print(table[columns].round(1).to_string(index=False))
    found.plot().savefig("compared.png")
