# README's code is compiled code: see readme_snippets.sh.
if(EXISTS "${PROJECT_SOURCE_DIR}/README.md")
  add_test(NAME readme_snippets COMMAND sh "${CMAKE_CURRENT_LIST_DIR}/readme_snippets.sh" "${PROJECT_SOURCE_DIR}")
  set_tests_properties(readme_snippets PROPERTIES LABELS build)
endif()
