fn main() {
    print!("{}", wm_weather::reference_page::markdown());
}
