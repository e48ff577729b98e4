//! A viewer that runs, as its address and the system tell of it.

/// Splits the address that a viewer prints, `http://HOST:PORT/#token=TOKEN`, into `HOST:PORT` and
/// the token.
pub fn address_and_token(printed: &str) -> Option<(String, String)> {
    let (_, address) = printed.split_once("http://")?;
    let (address, token) = address.split_once("/#token=")?;
    Some((address.to_owned(), token.trim().to_owned()))
}

/// Returns a figure of memory from `/proc/PID/status`, such as `VmRSS` or `VmHWM`, MiB; `None`
/// where the system has no such file.
pub fn mebibytes(pid: u32, name: &str) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
    Some(line.trim().trim_end_matches(" kB").parse::<f64>().ok()? / 1024.0)
}
