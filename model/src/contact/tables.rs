//! The dissertation's tables of contact quantities, computed.

use crate::{EffectiveLength, Error, Scene, defect_contact, integral_contact};

/// Rows of numbers under named columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Names of the columns.
    pub columns: Vec<&'static str>,
    /// Values, one list per row, in the order of the columns.
    pub rows: Vec<Vec<f64>>,
}

/// One quantity of a scene.
pub type Field = fn(&mut Scene) -> &mut f64;

/// A quantity of the scene that a column varies.
type Factor = (&'static str, Field);

/// A quantity that a table lists, in the table's unit.
type Listed = fn(&Scene) -> Result<f64, Error>;

/// What the tables vary, by the name of the column.
pub const FACTORS: [(&str, Field); 7] = [
    ("v_i", |s| &mut s.velocity_m_per_s),
    ("m_1", |s| &mut s.m_1_kg),
    ("m_2", |s| &mut s.m_2_kg),
    ("e_1", |s| &mut s.e_1_pa),
    ("e_2", |s| &mut s.e_2_pa),
    ("h", |s| &mut s.h_m),
    ("l", |s| &mut s.l_m),
];
/// Columns of the integral model's tables.
const INTEGRAL_FACTORS: usize = 5;

/// Table `number` of the dissertation, with `rule` for the crack's effective length.
///
/// Each column varies one quantity of the baseline by the row's `factor`, 0.1 to 2.0. Units: F_max in N in Tables 4 and
/// 8; tau in ms in 5 and 9; alpha in mm in 6; alpha plus bending in mm in 10; lambda_f in percent in 11.
///
/// # Errors
/// [`Error::NoTable`] for any other number.
///
/// ```
/// use tapline_model::{EffectiveLength, table};
///
/// let table = table(8, EffectiveLength::Published)?;
/// assert_eq!(table.columns, ["factor", "v_i", "m_1", "m_2", "e_1", "e_2", "h", "l"]);
/// assert!((table.rows[9][1] - 33.650495).abs() < 1e-5);
/// # Ok::<(), tapline_model::Error>(())
/// ```
pub fn table(number: u8, rule: EffectiveLength) -> Result<Table, Error> {
    let (factors, value): (&[Factor], Listed) = match number {
        4 => (&FACTORS[..INTEGRAL_FACTORS], |s| Ok(integral_contact(s)?.f_max_n)),
        5 => (&FACTORS[..INTEGRAL_FACTORS], |s| Ok(integral_contact(s)?.tau_s * 1e3)),
        6 => (&FACTORS[..INTEGRAL_FACTORS], |s| Ok(integral_contact(s)?.alpha_max_m * 1e3)),
        8 => (&FACTORS, |s| Ok(defect_contact(s)?.f_max_n)),
        9 => (&FACTORS, |s| Ok(defect_contact(s)?.tau_s * 1e3)),
        10 => (&FACTORS, |s| Ok(defect_contact(s)?.d_max_m * 1e3)),
        11 => (&FACTORS, |s| Ok(defect_contact(s)?.lambda_f * 100.0)),
        _ => return Err(Error::NoTable { number }),
    };
    let baseline = Scene { effective_length: rule, ..Scene::default() };
    let columns = std::iter::once("factor").chain(factors.iter().map(|&(name, _)| name)).collect();
    let row = |tenths: u8| -> Result<Vec<f64>, Error> {
        let factor = f64::from(tenths) / 10.0;
        let mut row = vec![factor];
        for (_, field) in factors {
            let mut scene = baseline;
            *field(&mut scene) *= factor;
            row.push(value(&scene)?);
        }
        Ok(row)
    };
    Ok(Table { columns, rows: (1..=20).map(row).collect::<Result<_, _>>()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table, row (tenths), column, value as printed, tolerance relative.
    const PRINTED: [(u8, usize, &str, f64, f64); 12] = [
        (4, 1, "v_i", 2.1546634, 1e-6),
        (4, 20, "e_2", 45.054509, 1e-6),
        (5, 1, "m_1", 0.3512733, 1e-6),
        (6, 20, "m_2", 0.5602997, 1e-6),
        (8, 1, "h", 6.6127609, 1e-6),
        (8, 20, "l", 32.689154, 1e-6),
        (9, 1, "h", 3.955044, 1e-6),
        (9, 15, "l", 0.78719, 1e-5),
        (10, 1, "h", 2.783273, 1e-6),
        (10, 5, "l", 0.564164, 1e-6),
        (11, 1, "h", 93.264, 1e-5),
        (11, 20, "l", 7.004, 1e-4),
    ];

    /// Catches a wrong column, unit or quantity in any table.
    #[test]
    fn tables_hold_the_printed_values() {
        for (number, tenths, column, printed, tolerance) in PRINTED {
            let table = table(number, EffectiveLength::Published).unwrap();
            let at = table.columns.iter().position(|&c| c == column).unwrap();
            let value = table.rows[tenths - 1][at];
            assert!((value / printed - 1.0).abs() < tolerance, "table {number} {column}: {value} for {printed}");
        }
    }

    /// Catches any wrong cell of the seven tables.
    #[test]
    fn tables_equal_the_files() {
        let Some(folder) = tapline_testing::shared("dissertation-tables") else { return };
        let mut compared = 0;
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let number: u8 = name["table".len()..][..2].parse().unwrap();
            let computed = table(number, EffectiveLength::Published).unwrap();
            let text = std::fs::read_to_string(&path).unwrap();
            let mut lines = text.lines();
            assert_eq!(lines.next().unwrap(), computed.columns.join(","), "{name}");
            for (line, row) in lines.zip(&computed.rows) {
                let printed: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
                assert_eq!(printed.len(), row.len(), "{name}");
                for (p, c) in printed.iter().zip(row) {
                    // Table 11 is printed to three decimals: half a unit of the last, plus rounding.
                    let bound = if number == 11 { 0.501e-3 } else { 1e-6 * p };
                    assert!((p - c).abs() <= bound, "{name}: {c} for {p}");
                    compared += 1;
                }
            }
        }
        assert_eq!(compared, 20 * (3 * 6 + 4 * 8));
    }

    /// Catches a rule that is not passed on: with Table 1 the l column changes, the others at w/l = 2 do not.
    #[test]
    fn the_rule_changes_the_length_column_only() {
        let published = table(11, EffectiveLength::Published).unwrap();
        let table_1 = table(11, EffectiveLength::Table1).unwrap();
        for (a, b) in published.rows.iter().zip(&table_1.rows) {
            assert!(a[..7].iter().zip(&b[..7]).all(|(a, b)| (a / b - 1.0).abs() < 1e-12), "{a:?} {b:?}");
        }
        // l = 1.5 x 25.4 mm: w/l = 4/3, l_e/l = 0.599 + 0.034/3 = 0.610333 against 0.594667; lambda ~ l_e^2 for small lambda.
        let ratio = table_1.rows[14][7] / published.rows[14][7];
        let expected = (0.610_333_3_f64 / 0.594_666_7).powi(2);
        assert!((ratio / expected - 1.0).abs() < 5e-3, "{ratio} for {expected}");
    }

    /// Catches a number that is accepted although there is no such table.
    #[test]
    fn other_numbers_are_refused() {
        for number in [0, 1, 3, 7, 12, 255] {
            assert_eq!(table(number, EffectiveLength::Published), Err(Error::NoTable { number }));
        }
    }
}
