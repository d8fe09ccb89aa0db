fn main() {
    std::process::exit(cd_post::run(std::env::args_os()))
}
