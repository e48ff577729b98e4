//! Names and units of columns.

/// The quantity in a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Field {
    Time,
    Date,
    Year,
    Month,
    Day,
    Hour,
    Temperature,
    DewPoint,
    Humidity,
    Rain,
    Showers,
    Precipitation,
    /// As depth of fresh snow.
    Snowfall,
    SnowDepth,
    Visibility,
    WindSpeed,
    WindFrom,
    WindGust,
    Clouds,
    Code,
    MeteostatCode,
}

/// Names, the unit that counts where none is given, and the range of values in the table's own unit
/// (see [`scale`]).
const COLUMNS: &[(&[&str], Field, &str, [f64; 2])] = &[
    (&["time", "datetime", "valid_time"], Field::Time, "", [0.0, 0.0]),
    (&["date"], Field::Date, "", [0.0, 0.0]),
    (&["year"], Field::Year, "", [1800.0, 2500.0]),
    (&["month"], Field::Month, "", [1.0, 12.0]),
    (&["day"], Field::Day, "", [1.0, 31.0]),
    (&["hour"], Field::Hour, "", [0.0, 24.0]),
    (&["temperature_2m", "temp", "temperature", "t2m"], Field::Temperature, "degC", [-90.0, 60.0]),
    (&["dew_point_2m", "dewpoint_2m", "dwpt", "dew_point"], Field::DewPoint, "degC", [-100.0, 50.0]),
    (&["relative_humidity_2m", "relativehumidity_2m", "rhum", "humidity"], Field::Humidity, "%", [0.0, 1.1]),
    (&["rain"], Field::Rain, "mm", [0.0, 500.0]),
    (&["showers"], Field::Showers, "mm", [0.0, 500.0]),
    (&["precipitation", "prcp"], Field::Precipitation, "mm", [0.0, 500.0]),
    (&["snowfall"], Field::Snowfall, "cm", [0.0, 5.0]),
    (&["snow_depth"], Field::SnowDepth, "m", [0.0, 50.0]),
    (&["snwd"], Field::SnowDepth, "cm", [0.0, 50.0]),
    (&["snow"], Field::SnowDepth, "mm", [0.0, 50.0]),
    (&["visibility"], Field::Visibility, "m", [0.0, 1e6]),
    (&["wind_speed_10m", "windspeed_10m", "wspd", "wind_speed"], Field::WindSpeed, "km/h", [0.0, 120.0]),
    (
        &["wind_direction_10m", "winddirection_10m", "wdir", "wind_direction"],
        Field::WindFrom,
        "deg",
        [0.0, 360.0],
    ),
    (&["wind_gusts_10m", "windgusts_10m", "wpgt", "wind_gusts"], Field::WindGust, "km/h", [0.0, 150.0]),
    (&["cloud_cover", "cloudcover"], Field::Clouds, "%", [0.0, 1.0]),
    (&["cldc"], Field::Clouds, "oktas", [0.0, 9.0 / 8.0]),
    (&["weather_code", "weathercode", "ww"], Field::Code, "", [0.0, 99.0]),
    (&["coco"], Field::MeteostatCode, "", [0.0, 27.0]),
];

/// A service whose tables are not read: some of its columns are called as those of others and have
/// other units.
struct OtherService {
    name: &'static str,
    /// Columns that only its tables have together, lower case.
    columns: &'static [&'static str],
}

const OTHER_SERVICES: &[OtherService] = &[
    OtherService { name: "Visual Crossing", columns: &["precipprob", "sealevelpressure"] },
    OtherService { name: "the Iowa Environmental Mesonet", columns: &["valid", "tmpf", "drct"] },
    OtherService { name: "OpenWeather", columns: &["dt_iso", "feels_like"] },
    OtherService { name: "NOAA's Integrated Surface Database", columns: &["wnd", "cig", "vis"] },
    OtherService { name: "NOAA's Local Climatological Data", columns: &["hourlydrybulbtemperature"] },
    OtherService { name: "Deutscher Wetterdienst", columns: &["stations_id", "mess_datum"] },
];

/// Returns the name of the service whose tables have these columns, if it is one whose tables are
/// not read.
pub(super) fn other_service<'a>(names: impl Iterator<Item = &'a str> + Clone) -> Option<&'static str> {
    let has = |wanted: &str| names.clone().any(|name| name.trim().eq_ignore_ascii_case(wanted));
    let found = OTHER_SERVICES.iter().find(|service| service.columns.iter().all(|column| has(column)));
    found.map(|service| service.name)
}

/// A column that is understood.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    pub(crate) field: Field,
    scale: fn(f64) -> f64,
    range: [f64; 2],
}

/// Names of all columns.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    COLUMNS.iter().flat_map(|(names, ..)| names.iter().copied())
}

impl Column {
    /// The column of a name, with its unit or an empty one; `None` if there is none of the name.
    ///
    /// # Errors
    /// The units that it takes, if it does not take this one.
    pub(super) fn of(name: &str, unit: &str, has_snow_depth: bool) -> Option<Result<Self, String>> {
        let (_, mut field, mut usual, mut range) =
            *COLUMNS.iter().find(|(names, ..)| names.iter().any(|known| known.eq_ignore_ascii_case(name)))?;
        // Meteostat once had the depth in mm as `snow`; since it has `snwd` that is fresh snow in
        // cm.
        if name == "snow" && has_snow_depth {
            (field, usual, range) = (Field::Snowfall, "cm", [0.0, 5.0]);
        }
        let unit = if unit.is_empty() { usual } else { unit };
        Some(match scale(field, unit) {
            Some(scale) => Ok(Self { field, scale, range }),
            None => Err(format!("has the unit `{unit}`, which it does not take: {usual} is usual")),
        })
    }

    /// A number of the file in SI units, mm, degrees Celsius or a share.
    ///
    /// # Errors
    /// The range that it must be in.
    pub(super) fn value(&self, number: f64) -> Result<f64, String> {
        let value = (self.scale)(number);
        let [least, most] = self.range;
        // Angles of 360 and a little, from averages.
        if value >= least && value <= most {
            Ok(value)
        } else {
            Err(format!("is {number}, {value} in the unit used here: must be {least} to {most}"))
        }
    }
}

/// The factor of a unit: into m (snow, visibility), mm (water), m/s, degrees Celsius, shares.
fn scale(field: Field, unit: &str) -> Option<fn(f64) -> f64> {
    let unit = unit.to_lowercase();
    let unit = unit.trim();
    Some(match field {
        Field::Temperature | Field::DewPoint => match unit {
            "degc" | "\u{b0}c" | "c" | "celsius" => |v| v,
            "\u{b0}f" | "f" | "degf" | "fahrenheit" => |v| (v - 32.0) / 1.8,
            "k" | "kelvin" => |v| v - 273.15,
            _ => return None,
        },
        Field::WindSpeed | Field::WindGust => match unit {
            "km/h" | "kmh" => |v| v / 3.6,
            "m/s" | "ms" => |v| v,
            "mp/h" | "mph" => |v| v * 0.447_04,
            "kn" | "kt" | "knots" => |v| v * 0.514_444,
            _ => return None,
        },
        Field::Rain | Field::Showers | Field::Precipitation => match unit {
            "mm" | "kg/m^2" => |v| v,
            "inch" | "in" => |v| 25.4 * v,
            "m" => |v| 1000.0 * v,
            _ => return None,
        },
        Field::Snowfall | Field::SnowDepth | Field::Visibility => match unit {
            "m" => |v| v,
            "cm" => |v| 0.01 * v,
            "mm" => |v| 0.001 * v,
            "km" => |v| 1000.0 * v,
            "ft" => |v| 0.3048 * v,
            "inch" | "in" => |v| 0.0254 * v,
            "mi" => |v| 1609.344 * v,
            _ => return None,
        },
        Field::Humidity | Field::Clouds => match unit {
            "%" => |v| v / 100.0,
            "1" => |v| v,
            "oktas" | "okta" => |v| v / 8.0,
            _ => return None,
        },
        _ => |v| v,
    })
}

/// The WMO's codes of present weather for Meteostat's 1 to 27.
pub(super) const METEOSTAT_CODES: [u8; 27] =
    [0, 1, 2, 3, 45, 48, 61, 63, 65, 66, 67, 68, 69, 71, 73, 75, 80, 82, 83, 84, 85, 86, 13, 89, 95, 97, 18];
